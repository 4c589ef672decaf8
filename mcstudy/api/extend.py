"""A larger study in the same cube."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Unpack

from mcstudy.api.where import Where, cluster_options
from mcstudy.study.extend import Growth
from mcstudy.study.extend import extend as extend_cube
from mcstudy.study.run import Outcome


def extend(
    out: str | Path,
    *,
    realizations: int | None = None,
    starts: int | None = None,
    fmax: Iterable[float] = (),
    amplitude: Iterable[float] = (),
    groups: Iterable[str] = (),
    **where: Unpack[Where],
) -> Outcome:
    """Add realizations, starts, Fmax values or amplitudes to a results cube; only the new cells are run.

    Parameters
    ----------
    out
        Path of the cube. Open it with `open_results` afterwards.
    realizations, starts
        New totals; as in the cube when None. Where starts are drawn until certain, ``starts`` is the new maximum.
    fmax, amplitude
        Values to add, Hz and the unit of the stimulus.
    groups
        Names of the groups to extend; all when empty.
    where
        Where to run, as for `run`.

    Returns
    -------
    Outcome
        ``fits`` and ``seconds`` of this call, ``skipped`` (done before), ``counts`` by status, ``failed_blocks``.

    Raises
    ------
    DesignError
        The extension is no valid study.
    StoreError
        The cube cannot be used.
    Interrupted
        It was stopped; the same call resumes it. The cube is the old or the new one, with all finished fits.
    """
    growth = Growth(realizations, starts, tuple(fmax), tuple(amplitude), tuple(groups))
    return extend_cube(out, growth, cluster_options(where), where.get("block"))
