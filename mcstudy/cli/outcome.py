"""The end of a run: what it did, and its statistics, so that the first look at its cube finds them kept."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.study.execution.submission import Outcome

LEAST_FITS = 10_000
"""A smaller study is run in less time than its statistics take; they are left to the first look."""

LOOK_S = 0.02
"""Seconds between two looks for a request to stop."""


def tell(outcome: Outcome, out: Path) -> Exit:
    """Print what a run did; returns the exit code."""
    if not outcome.fits and not outcome.failed_blocks:
        print(f"{out}: complete: nothing to run ({outcome.skipped} fits stored)")
        return Exit.DONE
    rate = f", {outcome.fits / outcome.seconds:.0f} fits/s" if outcome.seconds > 0 and outcome.fits else ""
    spared = f", {outcome.not_needed} not needed" if outcome.not_needed else ""
    print(f"{out}: {outcome.fits} fits in {outcome.seconds:.1f} s{rate}{spared}; {outcome.skipped} already done")
    for line in outcome.failed_blocks:
        print(f"failed block: {line}")
    if not (outcome.failed_blocks or outcome.failed_fits):
        print(f"next: mcstudy show {out}; mcstudy report {out}")
        return Exit.DONE
    from mcstudy.study.cube.store import Cube
    from mcstudy.study.failures import failed_fits

    for line in failed_fits(Cube.open(out)):
        print(f"failed fit: {line}")
    return Exit.FITS_FAILED


def prepare(outcome: Outcome, out: Path) -> None:
    """Compute and keep what ``mcstudy show OUT`` prints, if this run has finished a study worth it.

    It is not part of the run: a request to stop ends it at once, and the run remains complete. Cubes that are larger
    than what is held in memory are left to the first look too.
    """
    from mcstudy.analysis.results import FITS_IN_MEMORY  # slow to import: only once the fits are done

    complete = outcome.fits > 0 and not outcome.failed_blocks
    if not complete or not LEAST_FITS <= outcome.fits + outcome.skipped <= FITS_IN_MEMORY:
        return
    from mcstudy.analysis.show.tables import show
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.stopping import stop_requests

    def work() -> None:
        with contextlib.suppress(Exception):  # the look itself meets it too, and reports it
            show(out)

    thread = threading.Thread(target=work, name="mcstudy-first-look", daemon=True)
    with stop_requests() as stop, activity(f"{out}: complete; computing its statistics for mcstudy show"):
        thread.start()
        while thread.is_alive() and not stop.is_set():
            thread.join(LOOK_S)
