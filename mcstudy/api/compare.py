"""Two groups of people: what differs, where, and which parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy.api.recordings import RecordingLike
from mcstudy.errors import InputError, RecordingError
from mcstudy.group_comparison.compare import compare_groups
from mcstudy.recordings.copies import equal_rows, refuse_copies
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.soundness import faults_in_words, with_left_out
from mcstudy.results.comparison import Comparison
from mcstudy.spectra.frf_points import group_of
from mcstudy.stance.ranges import Range

PERMUTATIONS = Range(19, 1_000_000)
"""Relabellings of a comparison; with 19 the smallest p-value is 0.05."""


def compare(
    a: xr.Dataset | Sequence[RecordingLike],
    b: xr.Dataset | Sequence[RecordingLike],
    *,
    paired: bool | None = None,
    names: tuple[str, str] = ("a", "b"),
    permutations: int = 999,
    fmax: float | None = None,
    discard: int = 1,
    seed: int = 0,
) -> Comparison:
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
        Of recordings: highest frequency, Hz, 8 when None; cycles left out at the start.
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
    read = [_recordings(given, name) for given, name in ((a, "a"), (b, "b"))]
    refuse_copies(
        (f"{name}: {r.name}", r)
        for name, given in zip(names, read, strict=True)
        if not isinstance(given, xr.Dataset)
        for r in given
    )
    groups, notes = [], []
    for given, where, name in zip(read, ("a", "b"), names, strict=True):
        group, left_out = _group(given, where, fmax, discard)
        groups.append(group)
        notes += [f"{name}: {note}" for note in left_out]
    _refuse_equal(groups, names)
    comparison = compare_groups(groups[0], groups[1], paired, permutations, seed, names)
    return Comparison.of(replace(comparison, notes=tuple(notes)))


def _recordings(given: xr.Dataset | Sequence[RecordingLike], where: str) -> xr.Dataset | list[Recording | FrfRecording]:
    if isinstance(given, xr.Dataset):
        if missing := [name for name in ("frf", "average") if name not in given]:
            raise InputError(f"{where}: expected what read_frf_group returns, {', '.join(missing)} missing")
        return given
    if isinstance(given, str | Path) or not len(given):
        raise InputError(f"{where}: expected a group of FRFs or a list of recordings, got {given!r}")
    return [read_recording(r) if isinstance(r, str | Path) else r for r in given]


def _refuse_equal(groups: Sequence[xr.Dataset], names: Sequence[str]) -> None:
    """Raise `RecordingError` if two people have the same responses, in one group or in both."""
    if groups[0]["frf"].shape[1:] != groups[1]["frf"].shape[1:]:
        return
    people = [f"{name}: {p}" for name, g in zip(names, groups, strict=True) for p in g["person"].values]
    pair = equal_rows(np.concatenate([g["frf"].values for g in groups]))
    if pair is not None:
        raise RecordingError(
            f"{people[pair[1]]}: has the same responses as {people[pair[0]]}; expected every person once"
        )


def _group(
    read: xr.Dataset | Sequence[Recording | FrfRecording], where: str, fmax: float | None, discard: int
) -> tuple[xr.Dataset, list[str]]:
    """The responses of a group, and what was left out of its recordings, with the reason."""
    if isinstance(read, xr.Dataset):
        return read, []
    people = [str(getattr(r, "person", "") or r.name) for r in read]
    if twice := next((p for p in people if people.count(p) > 1), None):
        raise InputError(f"{where}: expected one recording of every person, got several of {twice!r}")
    sound = [with_left_out(r, discard=discard) if isinstance(r, Recording) else r for r in read]
    notes = [
        f"{fault.message}; these cycles are left out"
        for r, kept in zip(read, sound, strict=True)
        if isinstance(r, Recording) and kept is not r
        for k, trial in enumerate(r.trials, start=1)
        for fault in faults_in_words(r, trial, f"{r.name}: trial {k}")
    ]
    return group_of(sound, people, fmax, discard), notes
