"""The whole diagnosis of a recording: where the model fails, which effect is missing, how far the gap shrinks.

`diagnose` refits the model to every draw of the null; `diagnose_fast` draws through the linearised fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from mcstudy.errors import InputError, RecordingError
from mcstudy.gap.ambiguity import undetectable
from mcstudy.gap.checks import check, check_noise
from mcstudy.gap.close import Belief, Closed, close, floor_rms_deg, sway_rms_deg
from mcstudy.gap.diagnosis import LEVEL, Diagnosis, Shift, sources
from mcstudy.gap.explain import Cause, Explanation, explain
from mcstudy.gap.fitting import Data, Fitted
from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.lines import Lines
from mcstudy.gap.locate import missing_torque, places
from mcstudy.gap.measure import measure
from mcstudy.gap.plausible import merged, plausibility, refuse
from mcstudy.gap.recording import Recording
from mcstudy.gap.scores import Scores
from mcstudy.gap.tested import Tested, tested
from mcstudy.stance.feedback import Model
from mcstudy.study.streams import stream

FAST_DRAWS = 1000
BOOTSTRAP = 1000

LEAST_DRAWS = 50
"""Fewest draws of a bootstrap: with fewer than 31 no p-value could be below `LEVEL`."""

CREDIBLE = 0.95


def diagnose(
    recording: Recording | FrfRecording | Sequence[Recording],
    *,
    bootstrap: int = BOOTSTRAP,
    seed: int = 0,
    model: Model | None = None,
    fmax: float = 8.0,
    discard: int = 1,
    accept: Iterable[str] = (),
) -> Diagnosis:
    """Diagnosis with a parametric bootstrap: the base model is refitted to every one of ``bootstrap`` draws.

    Parameters
    ----------
    recording: one, or several of the same person, stimulus and sampling, which are pooled.
    seed: of every random number. model: base model; the two-segment one of the recording's body when None.
    fmax: highest line, Hz. discard: transient cycles left out of every trial.
    accept: codes of suspicions about mislabelled channels that the user wants to keep.

    Raises `RecordingError` for recordings that cannot be analysed or whose channels are not what they are labelled.
    """
    if bootstrap < LEAST_DRAWS:
        raise InputError(f"bootstrap: expected at least {LEAST_DRAWS} draws, got {bootstrap}")
    return _diagnose(pooled(recording), bootstrap, True, seed, model, fmax, discard, accept)


def diagnose_fast(
    recording: Recording | FrfRecording | Sequence[Recording],
    *,
    seed: int = 0,
    model: Model | None = None,
    fmax: float = 8.0,
    discard: int = 1,
    accept: Iterable[str] = (),
) -> Diagnosis:
    """Diagnosis with asymptotic nulls: draws of noise and its covariance through the linearised fit. See `diagnose`."""
    return _diagnose(pooled(recording), FAST_DRAWS, False, seed, model, fmax, discard, accept)


def detect_fast(
    recording: Recording | FrfRecording | Sequence[Recording],
    *,
    seed: int = 0,
    model: Model | None = None,
    fmax: float = 8.0,
    discard: int = 1,
    accept: Iterable[str] = (),
) -> Tested:
    """Only whether there is a gap, exactly as `diagnose_fast` decides it, in half the time. See `diagnose`."""
    whole = pooled(recording)
    lines, _ = _measured(whole, fmax, discard, accept)
    return tested(lines, model or whole.base_model(), FAST_DRAWS, False, seed)


def pooled(recording: Recording | FrfRecording | Sequence[Recording]) -> Recording | FrfRecording:
    """One recording with all trials; raises `RecordingError` when kind, sampling or body differ."""
    if isinstance(recording, Recording | FrfRecording):
        return recording
    if not recording:
        raise RecordingError("recordings: expected at least one")
    first, *rest = recording
    for r in rest:
        for field in ("rate_hz", "period_s", "stimulus", "body", "convention"):
            if getattr(r, field) != getattr(first, field):
                raise RecordingError(
                    f"{r.name}: {field}: expected {getattr(first, field)!r} as in {first.name}, "
                    f"got {getattr(r, field)!r}; diagnose them apart"
                )
    return replace(
        first,
        trials=tuple(t for r in recording for t in r.trials),
        suspicions=merged(*(r.suspicions for r in recording)),
    )


def _diagnose(
    recording: Recording | FrfRecording,
    draws: int,
    refits: bool,
    seed: int,
    model: Model | None,
    fmax: float,
    discard: int,
    accept: Iterable[str],
) -> Diagnosis:
    lines, warnings = _measured(recording, fmax, discard, accept)
    outcome = diagnose_lines(
        lines, model or recording.base_model(), draws=draws, refits=refits, seed=seed, name=recording.name
    )
    return replace(
        outcome,
        warnings=(*warnings, *outcome.warnings),
        method={**outcome.method, "fmax": fmax, "discard": discard},
    )


def diagnose_lines(
    lines: Lines, nominal: Model, *, draws: int, refits: bool, seed: int = 0, name: str = "lines"
) -> Diagnosis:
    """Diagnosis of measured lines under a base model whose values are the order of magnitude of a person's."""
    t = tested(lines, nominal, draws, refits, seed)
    base, data, detection, compared = t.base, t.data, t.detection, t.contrasts
    explanation = explain(base, t.minima, data, t.effects, t.signatures, t.groups, t.scores, detection.rough, compared)
    detected = t.p_value < LEVEL
    leading = explanation.causes[0] if detected and explanation.causes else None
    place, abstained = places(explanation)
    trials = int(np.unique(lines.trial).size)
    belief = Belief(explanation.hypotheses, explanation.unknown, detection.null_chi2)
    return Diagnosis(
        name=name,
        detected=detected,
        p_value=t.p_value,
        p_least=t.p_least,
        place=place,
        place_abstained=abstained,
        causes=explanation.causes,
        none_probability=explanation.none,
        unknown_probability=explanation.unknown,
        credible_set=credible_set(explanation),
        closed=None if leading is None else _closed(base, leading, data, lines, t.scores, belief, seed),
        sway_rms_deg=_sway(base, leading, data, lines),
        undetectable=undetectable(t.signatures, compared, trials),
        detection=detection,
        contrasts=tuple(compared),
        shifts=_shifts(base, leading),
        groups=tuple(t.groups),
        f=lines.f,
        torque=missing_torque(base, data),
        warnings=tuple(_other_axes(lines)),
        method={
            "null": "bootstrap with refits" if refits else "linearised",
            "draws": draws,
            "seed": seed,
            "trials": trials,
            "repeats": int(lines.repeats.shape[0]),
        },
    )


def _measured(
    recording: Recording | FrfRecording, fmax: float, discard: int, accept: Iterable[str]
) -> tuple[Lines, tuple[str, ...]]:
    """The lines of a recording, and what is odd about it; raises `RecordingError` for what is refused."""
    if isinstance(recording, FrfRecording):
        lines = measure(recording, fmax, discard)
        check_noise(lines, recording.name)
        return lines, ("only one angle was published, so the hip is not tested",) if recording.single else ()
    noted = check(recording)
    lines = measure(recording, fmax, discard)
    check_noise(lines, recording.name)
    # All of them before the decision: what one check noted says nothing about what another would find.
    found = merged(recording.suspicions, noted, plausibility(recording, lines))
    refuse(found, accept)
    return lines, tuple(s.message for s in found)


def _other_axes(lines: Lines) -> list[str]:
    """Even lines: an even nonlinearity excites what the stimulus does not."""
    if lines.even is None:
        return []
    ratio, p = lines.even.excess(0.02, 2.0)
    if not np.isfinite(p).all() or p.min() > 1e-3:
        return []
    return [f"even lines hold {ratio[int(p.argmin())]:.2g} times their noise (p = {p.min():.1g}): an even nonlinearity"]


def credible_set(explanation: Explanation) -> tuple[int | str, ...]:
    """Smallest set of causes (by index), "unknown" and "none" with at least `CREDIBLE` of the posterior."""
    entries: list[tuple[float, int | str]] = [(c.probability, k) for k, c in enumerate(explanation.causes)]
    entries += [(explanation.unknown, "unknown"), (explanation.none, "none")]
    out: list[int | str] = []
    total = 0.0
    for p, entry in sorted(entries, key=lambda e: -e[0]):
        out.append(entry)
        total += p
        if total >= CREDIBLE:
            break
    return tuple(out)


def _closed(
    base: Fitted, leading: Cause, data: Data, lines: Lines, scores: Scores, belief: Belief, seed: int
) -> Closed:
    space = np.concatenate(
        [
            *(s.vector[:, None] for s in scores.library),
            *(f.columns for f in scores.families[:4]),
        ],
        axis=1,
    )
    return close(base, leading.fitted, data, lines, space, belief, stream(seed, "gap closed"))


def _sway(base: Fitted, leading: Cause | None, data: Data, lines: Lines) -> dict[str, float | None]:
    if not np.isfinite(lines.power).all():
        return {"before": None, "after": None, "floor": None}
    return {
        "before": sway_rms_deg(base, data, lines),
        "after": None if leading is None else sway_rms_deg(leading.fitted, data, lines),
        "floor": floor_rms_deg(base if leading is None else leading.fitted, data, lines),
    }


def _shifts(base: Fitted, leading: Cause | None) -> tuple[Shift, ...]:
    se = np.sqrt(np.diag(base.covariance))
    added_se = None if leading is None else np.sqrt(np.diag(leading.fitted.covariance))
    origin = sources(base)
    added_origin = None if leading is None else sources(leading.fitted)
    out = []
    for k, p in enumerate(base.model.parameters):
        added = None if leading is None else float(leading.fitted.theta[k])
        error = None if added_se is None else float(added_se[k])
        origins = origin[k], None if added_origin is None else added_origin[k]
        out.append(Shift(p.name, p.unit, float(base.theta[k]), float(se[k]), added, error, *origins))
    return tuple(out)
