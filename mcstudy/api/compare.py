"""Two groups of people: what differs, where, and which parameter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from mcstudy.api.recordings import AnyRecording
from mcstudy.errors import InputError
from mcstudy.group_comparison.compare import compare_groups
from mcstudy.recordings.io import read_recording
from mcstudy.report.comparison import ComparisonWithFigure
from mcstudy.spectra.frf_points import group_of
from mcstudy.stance.ranges import Range

PERMUTATIONS = Range(19, 1_000_000)
"""Relabellings of a comparison; with 19 the smallest p-value is 0.05."""


def compare(
    a: xr.Dataset | Sequence[AnyRecording],
    b: xr.Dataset | Sequence[AnyRecording],
    *,
    paired: bool | None = None,
    names: tuple[str, str] = ("a", "b"),
    permutations: int = 999,
    fmax: float = 8.0,
    discard: int = 1,
    seed: int = 0,
) -> ComparisonWithFigure:
    """What differs between two groups: whether, where, which parameter, and how much of the difference it closes.

    Parameters
    ----------
    a, b
        One condition of what `read_frf_group` returned, as ``group.sel(condition="open")``; or recordings or paths,
        one for every person. Their frequency responses are then estimated at the lines of the stimulus and averaged
        in at most 12 bands. A recording that names its person is known by it, any other by its own name.
    paired
        True: people of the same name are compared with themselves. False: different people. None: paired if the names
        are the same in both groups.
    names
        Of the groups, for text and figure.
    permutations
        Relabellings of the groups in the tests; all different ones where there are no more.
    fmax, discard
        Of recordings: highest frequency, Hz; cycles left out at the start.
    seed
        Random seed; the same seed gives the same numbers.

    Returns
    -------
    Comparison
        ``verdict()``, ``text()``, ``plot()``, ``to_dict()``; ``detection`` (tests), ``causes`` (changes of parameters
        by probability, none where no difference of the means was found).

    Raises
    ------
    InputError
        Groups have other points, other stimuli, or fewer than 4 people with all responses.
    """
    PERMUTATIONS.require(permutations, "permutations")
    groups = [_group(given, name, fmax, discard) for given, name in ((a, "a"), (b, "b"))]
    return ComparisonWithFigure.of(compare_groups(groups[0], groups[1], paired, permutations, seed, names))


def _group(given: xr.Dataset | Sequence[AnyRecording], where: str, fmax: float, discard: int) -> xr.Dataset:
    if isinstance(given, xr.Dataset):
        if missing := [name for name in ("frf", "average") if name not in given]:
            raise InputError(f"{where}: expected what read_frf_group returns, {', '.join(missing)} missing")
        return given
    if isinstance(given, str | Path) or not len(given):
        raise InputError(f"{where}: expected a group of FRFs or a list of recordings, got {given!r}")
    read = [read_recording(r) if isinstance(r, str | Path) else r for r in given]
    people = [str(getattr(r, "person", "") or r.name) for r in read]
    if twice := next((p for p in people if people.count(p) > 1), None):
        raise InputError(f"{where}: expected one recording of every person, got several of {twice!r}")
    return group_of(read, people, fmax, discard)
