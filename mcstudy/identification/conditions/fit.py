"""The fit of one person in several conditions: from recordings to estimates, intervals and what conditions share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from mcstudy.errors import InputError, RecordingError
from mcstudy.identification.conditions.record import ConditionsRecord
from mcstudy.identification.conditions.settings import ConditionSettings
from mcstudy.identification.conditions.sharing import sharings
from mcstudy.identification.correction import simulated
from mcstudy.identification.fit import BestFit, searched, with_intervals
from mcstudy.identification.loop_stability import stability
from mcstudy.lines.checked_recording import CheckedRecording, pooled
from mcstudy.lines.settling import settled
from mcstudy.recordings.columns import of_model
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import ConditionsRecording, JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import standing
from mcstudy.streams import stream

AnyPart = Recording | FrfRecording


def fit_conditions(
    recordings: Sequence[AnyPart], settings: ConditionSettings, conditions: Sequence[str] | None = None
) -> ConditionsRecord:
    """Parameters of a person who was recorded in several conditions; see `mcstudy.fit_conditions`.

    ``conditions``: of each recording, see `names_of`. Raises
    `RecordingError` for recordings that cannot be analysed together, `InputError` for a wrong setting.
    """
    names = names_of(recordings) if conditions is None else conditions
    if settings.model is not None and not standing(settings.model):
        recordings, settings = [of_model(r, settings.model) for r in recordings], replace(settings, model=None)
    joint = by_condition(recordings, names)

    def separate(checked: CheckedRecording) -> tuple[str, ...]:
        return settings.separate(checked.nominal)

    def best_of(checked: CheckedRecording) -> BestFit:
        return searched(checked.lines, checked.nominal, settings, joint.name, separate(checked))

    checked, best = settled(joint, settings, best_of)
    best = replace(best, lines=checked.lines)
    draws = simulated(best.lines.noise, stream(settings.seed, "fit correction"))
    fitted = with_intervals(best, settings, joint.name, draws=draws)
    fitted = replace(
        fitted,
        recording=checked.recording,
        warnings=(*checked.warnings, *fitted.warnings),
        method=replace(fitted.method, fmax=checked.fmax, discard=checked.discard),
        stability=stability(fitted.model, fitted.theta, fitted.estimates),
    )
    apart = separate(checked)
    told = sharings(best, checked.nominal, apart, settings, draws)
    return ConditionsRecord(fitted, joint.names, apart, told, checked.nominal)


def names_of(recordings: Sequence[AnyPart], files: Sequence[Path | None] = ()) -> list[str]:
    """The conditions that recordings state; if one states none, the names of their ``files``, or else their own."""
    stated = [getattr(r, "condition", "") for r in recordings]
    if all(stated):
        return stated
    return [f.stem if f else r.name for r, f in zip_longest(recordings, files)]


def by_condition(recordings: Sequence[AnyPart], conditions: Sequence[str]) -> ConditionsRecording:
    """The recordings as one, a part for each of the ``conditions`` (one per recording); those of one are pooled.

    Raises `InputError` for fewer than two conditions, `RecordingError` for recordings of one condition that differ in
    stimulus, period or sampling rate.
    """
    if len(conditions) != len(recordings) or not all(isinstance(name, str) and name for name in conditions):
        raise InputError(f"conditions: expected one name per recording, {len(recordings)} in all, got {conditions!r}")
    names = tuple(dict.fromkeys(conditions))
    if len(names) < 2:
        raise InputError(f"conditions: expected at least two, got {', '.join(names) or 'none'}")
    parts = []
    for name in names:
        part = pooled([r for r, condition in zip(recordings, conditions, strict=True) if condition == name])
        if isinstance(part, JointRecording):
            raise RecordingError(f"condition {name}: expected one stimulus, period and sampling rate, got several")
        parts.append(part)
    return ConditionsRecording(tuple(parts), names)  # type: ignore[arg-type]  # published responses are parts, too
