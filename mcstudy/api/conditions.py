"""The parameters of one person in several conditions, from paths or in memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcstudy.api.recordings import RecordingLike, read
from mcstudy.identification.conditions.fit import fit_conditions as fit_recordings
from mcstudy.identification.conditions.fit import names_of
from mcstudy.identification.conditions.settings import ConditionSettings
from mcstudy.recordings.columns import ModelLike
from mcstudy.results.conditions import ConditionsResult
from mcstudy.scheduler.compiling import PERSON, compile_kernels


def fit_conditions(
    recordings: Sequence[RecordingLike],
    *,
    conditions: Sequence[str] | None = None,
    per: Sequence[str] = (),
    shared: Sequence[str] = (),
    effects: Sequence[str] = (),
    quantities: Sequence[str] | Mapping[str, Any] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    level: float = 0.95,
    model: ModelLike | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    seed: int = 0,
) -> ConditionsResult:
    """Parameters of a person in several conditions, fitted at once, and tests of what the conditions share.

    Parameters
    ----------
    recordings
        What `read_recording` or `simulate` returned, or paths, of one person: recordings or published responses that
        differ in stimulus, amplitude or anything else. Those of one condition are pooled.
    conditions
        The condition of each; None for those that all recordings state, or else the names of their files (of
        recordings in memory, their own).
    per, shared
        Parameters with a value in each condition, and parameters that all conditions share; ``"all"`` for all. By
        default each condition has its own sensory weights and all else is shared; with ``shared`` alone all others
        have a value in each condition, with ``per`` alone all others are shared.
    effects, quantities, bounds, level, model, fmax, discard, accept, seed
        As for `fit`. Bounds of a parameter hold in every condition; its copy ``Wp_small`` may have bounds of its own,
        and be part of a quantity. Effects are shared. Without ``model`` recordings may state models that differ in
        their stimulus.

    Returns
    -------
    ConditionsResult
        Estimates by name and condition (``result["Wp", "small"].low``), ``sharing("tau").p_value``, ``text()``,
        ``fit`` (a `FitResult`) and ``to_dict()``.

    Raises
    ------
    RecordingError
        A recording cannot be analysed, or the bodies or models differ.
    InputError
        An argument is wrong, or there are fewer than two conditions.
    """
    settings = ConditionSettings(
        per=per,
        shared=shared,
        effects=effects,
        quantities=quantities,
        bounds=bounds,
        level=level,
        fmax=fmax,
        discard=discard,
        accept=accept,
        seed=seed,
    )
    known = read(recordings, model)
    files = [Path(r) if isinstance(r, str | Path) else None for r in recordings]
    compile_kernels(PERSON)
    return ConditionsResult.of(fit_recordings(known, settings, conditions or names_of(known, files)))
