"""Results cubes: checks, growth and page; what the verbs of the command line print."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Unpack

import xarray as xr

from mcstudy.adaptive import Until, parse_target
from mcstudy.adaptive import run_until as grow_until
from mcstudy.analysis.results import open_results
from mcstudy.api.studies import StudyLike, study_of
from mcstudy.api.where import Where, cluster_options
from mcstudy.report.document import page_of, write_page
from mcstudy.report.page import page
from mcstudy.study.cube.rounding import TOLERANCE
from mcstudy.study.extend import Growth
from mcstudy.study.extend import extend as extend_cube
from mcstudy.study.group import Label
from mcstudy.study.replay import Replay
from mcstudy.study.replay import replay as replay_fit
from mcstudy.study.verify import Findings
from mcstudy.study.verify import verify as verify_cube


def verify(cube: str | Path, *, cells: int = 20, seed: int = 0, tolerance: float | None = None) -> Findings:
    """Check every chunk of a cube and recompute a sample of fits.

    Parameters
    ----------
    cube
        Path of a results cube.
    cells
        Number of fits to recompute and compare bit for bit.
    seed
        Random seed for the choice of these fits.
    tolerance
        Relative difference of data and costs that is no fault where they were computed in another environment; 1e-6
        when None.

    Returns
    -------
    Findings
        ``damage``, ``beyond`` and ``notes``, one line per finding; empty lists where all is well.

    Raises
    ------
    StoreError
        There is no cube.
    """
    return verify_cube(cube, cells, seed, TOLERANCE if tolerance is None else tolerance)


def extend(
    cube: str | Path,
    *,
    realizations: int | None = None,
    starts: int | None = None,
    fmax: tuple[float, ...] = (),
    amplitude: tuple[float, ...] = (),
    groups: tuple[str, ...] = (),
    sweep: Mapping[str, Sequence[Label]] | None = None,
    **where: Unpack[Where],
) -> xr.DataTree:
    """Add cells to a cube, run the new ones only, and open it; a stop leaves the old or the new cube, and resumes.

    Parameters
    ----------
    cube
        Path of a results cube.
    realizations, starts
        New totals.
    fmax, amplitude
        Values to add, Hz and the unit of the stimulus.
    groups
        Names of the groups or sweeps to extend; all when empty.
    sweep
        Values to add to axes of sweeps, by the name of the axis.
    where
        Where to run, as in `run`.

    Returns
    -------
    xarray.DataTree
        The cube as `open_results` opens it.

    Raises
    ------
    DesignError
        The extension is empty or gives no valid study.
    StoreError
        The cube cannot be used.
    Interrupted
        The run was stopped; the same call resumes it.
    """
    further = tuple((axis, tuple(labels)) for axis, labels in (sweep or {}).items())
    growth = Growth(realizations, starts, tuple(fmax), tuple(amplitude), tuple(groups), further)
    extend_cube(cube, growth, cluster_options(where), where.get("block"))
    return open_results(cube, lazy=None)


def run_until(
    study: StudyLike,
    out: str | Path,
    target: str,
    budget_fits: int,
    *,
    quarantine: bool = False,
    allow_unstable: bool = False,
    say: Callable[[str], object] = str,
    **where: Unpack[Where],
) -> Until:
    """Run a study, and add realizations or starts until its Monte Carlo standard error is small enough.

    Parameters
    ----------
    study, out
        As in `run`.
    target
        Statistic and largest standard error in percent of the truth: ``"bias=2%"`` or ``"mean_bias=0.5%"``.
    budget_fits
        Largest number of fits.
    quarantine, allow_unstable
        As in `run`.
    say
        Called with one line for every extension.
    where
        Where to run, as in `run`.

    Returns
    -------
    Until
        ``reached``, ``statement`` and ``steps`` (one line per extension); the cube is at ``out``.

    Raises
    ------
    InputError
        The target cannot be read.
    DesignError, StudyChangedError, StoreError, Interrupted
        As `run`.
    """
    block = where.get("block")
    return grow_until(
        study_of(study),
        Path(out),
        parse_target(target),
        budget_fits,
        cluster_options(where),
        block,
        say,
        quarantine,
        allow_unstable=allow_unstable,
    )


def replay(
    cube: str | Path,
    realization: int,
    start: int,
    *,
    group: str | None = None,
    amplitude: float | None = None,
    fmax: float | None = None,
) -> Replay:
    """Repeat one stored fit and compare it with what is stored.

    Parameters
    ----------
    cube
        Path of a results cube.
    realization, start
        Indices, from 0.
    group, amplitude, fmax
        Group, amplitude (unit of the stimulus) and highest frequency (Hz) of the fit; not needed where there is one.

    Returns
    -------
    Replay
        Every iteration, and in which arrays the fit differs from the stored one.

    Raises
    ------
    InputError
        There is no such fit, or it has not been run.
    """
    return replay_fit(cube, realization=realization, start=start, group=group, amplitude=amplitude, fmax=fmax)


def write_report(cube: str | Path, page_file: str | Path | None = None, *, beside: tuple[str | Path, ...] = ()) -> Path:
    """Write the page of a study: tables and figures in one HTML file.

    Parameters
    ----------
    cube
        Path of a results cube.
    page_file
        File to write; by default that of the cube with ``.html``.
    beside
        Further results to include: cubes, or files that `pipelines/examples` make.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    StoreError
        The cube cannot be read.
    """
    source = Path(cube)
    file = page_of(source) if page_file is None else Path(page_file)
    return write_page(file, lambda: page(source, [Path(b) for b in beside]))
