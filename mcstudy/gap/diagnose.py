"""Diagnosis of a recording: where the model fails, which effect is missing, and how much of the gap it closes.

`diagnose` refits the model to every null sample; `diagnose_fast` uses the linearised fit instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Data, Fitted
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.candidates.unknown import LENGTHS
from mcstudy.gap.diagnosis import Diagnosis
from mcstudy.gap.questions.any_gap import GapTest, gap_test
from mcstudy.gap.questions.closure import Belief, Closure, close, floor_rms_deg, sway_rms_deg
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.gap.questions.location import locations, missing_torque
from mcstudy.gap.questions.mislabelling import Labels, mislabelled
from mcstudy.gap.questions.nearest import nearest, with_likeness
from mcstudy.gap.questions.parameters import shifts
from mcstudy.gap.questions.posterior import NONE, Cause, Explanation, explain, prior
from mcstudy.gap.questions.power import undetectable
from mcstudy.gap.settings import EVERYTHING, Asked
from mcstudy.lines.checked_recording import Discard, checked_lines, given_model
from mcstudy.lines.labels import label_odds
from mcstudy.lines.settling import cycles_to_discard, longer, unsettled
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint import AnyRecording, JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import highest
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream
from mcstudy.text_tables import p_words

FAST_DRAWS = 1000
BOOTSTRAP = 1000

LEAST_DRAWS = 50
"""Fewest bootstrap samples: with fewer than 31 no p-value could be below `LEVEL`."""

CREDIBLE = 0.95


def diagnose(
    recording: AnyRecording | Sequence[Recording | FrfRecording],
    *,
    bootstrap: int = BOOTSTRAP,
    seed: int = 0,
    model: Model | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    asked: Asked = EVERYTHING,
    prior_none: float = NONE,
) -> Diagnosis:
    """Diagnosis with a parametric bootstrap: the base model is refitted to each of ``bootstrap`` null samples.

    Parameters
    ----------
    recording: one recording, or several of the same person. Those with the same stimulus, period and sampling rate are
        pooled, others diagnosed together, each with the noise that was measured in it.
    bootstrap: number of null samples. seed: seed of all random numbers.
    model: base model; by default the two-segment model of the recording's body. None under several stimuli.
    fmax: highest frequency, Hz; None for 8, or the last of a published response. discard: transient cycles left out at
        the start of every trial; None for one, or as many as the slowest oscillation of the fitted body needs
        (`mcstudy.lines.settling`).
    accept: codes of suspicions about mislabelled channels. For these the labels are kept.
    asked: the questions that are answered; the results of the others are None.
    prior_none: prior probability of no missing effect.

    Raises `RecordingError` for a recording that cannot be analysed or whose channels are mislabelled, `InputError` for
    too small a ``bootstrap`` and an impossible ``prior_none``.
    """
    if bootstrap < LEAST_DRAWS:
        raise InputError(f"bootstrap: expected at least {LEAST_DRAWS} null samples, got {bootstrap}")
    return _diagnose(recording, _Settings(bootstrap, True, seed, model, fmax, discard, accept, asked, prior_none))


def diagnose_fast(
    recording: AnyRecording | Sequence[Recording | FrfRecording],
    *,
    seed: int = 0,
    model: Model | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    asked: Asked = EVERYTHING,
    prior_none: float = NONE,
) -> Diagnosis:
    """Diagnosis with asymptotic null distributions: simulated noise through the linearised fit. See `diagnose`."""
    return _diagnose(recording, _Settings(FAST_DRAWS, False, seed, model, fmax, discard, accept, asked, prior_none))


def detect_fast(
    recording: AnyRecording | Sequence[Recording | FrfRecording],
    *,
    seed: int = 0,
    model: Model | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
) -> GapTest:
    """Only the test for a gap, identical to that of `diagnose_fast`, in half the time. See `diagnose`."""
    return _tested(recording, _Settings(FAST_DRAWS, False, seed, model, fmax, discard, accept))[2]


@dataclass(frozen=True)
class _Settings:
    """How a recording is diagnosed, see `diagnose`: ``draws`` null samples, with ``refits`` of the model or without."""

    draws: int
    refits: bool
    seed: int
    model: Model | None
    fmax: float | None
    discard: int | None
    accept: Iterable[str]
    asked: Asked = EVERYTHING
    prior_none: float = NONE

    def lines_and_test(
        self, recording: AnyRecording | Sequence[Recording | FrfRecording], discard: Discard
    ) -> tuple[AnyRecording, Lines, GapTest]:
        """The recording without some cycles, its lines, and the test for a gap."""
        one, lines = checked_lines(recording, self.fmax, discard, self.accept)
        return one, lines, gap_test(lines, given_model(self.model, one, lines), self.draws, self.refits, self.seed)


def _tested(
    recording: AnyRecording | Sequence[Recording | FrfRecording], by: _Settings
) -> tuple[AnyRecording, Lines, GapTest, Discard]:
    """The recording, its lines, the test for a gap, and the number of discarded cycles."""
    chosen: Discard = 1 if by.discard is None else by.discard
    one, lines, test = by.lines_and_test(recording, chosen)
    needed = cycles_to_discard(one, test.base.model, test.base.theta) if by.discard is None else chosen
    if longer(needed, chosen):
        chosen = needed
        one, lines, test = by.lines_and_test(recording, chosen)
    notes = (*lines.notes, *unsettled(one, test.base.model, test.base.theta, chosen))
    return one, replace(lines, notes=notes), test, chosen


def _diagnose(recording: AnyRecording | Sequence[Recording | FrfRecording], by: _Settings) -> Diagnosis:
    known = frozenset((by.accept,) if isinstance(by.accept, str) else by.accept)
    prior(by.prior_none)  # refused before the work
    one, lines, test, left_out = _tested(recording, replace(by, accept=known))
    outcome = diagnose_lines(
        lines,
        given_model(by.model, one, lines),
        draws=by.draws,
        refits=by.refits,
        seed=by.seed,
        test=test,
        name=one.name,
        labels=None if isinstance(one, FrfRecording) else _labels(one, lines, known),
        asked=by.asked,
        prior_none=by.prior_none,
    )
    warnings = () if isinstance(one, FrfRecording) else tuple(s.message for s in one.suspicions)
    return replace(
        outcome,
        recording=one,
        warnings=(*warnings, *outcome.warnings),
        method={**outcome.method, "fmax": highest(one, by.fmax), "discard": left_out},
    )


def _labels(recording: Recording | JointRecording, lines: Lines, accept: frozenset[str]) -> Labels:
    if isinstance(recording, JointRecording):
        several = zip(recording.parts, lines.parts, recording.labels, strict=True)
        return Labels.joined([replace(_labels(r, own, accept), name=name) for r, own, name in several])
    return Labels(label_odds(recording, lines), recording.stimulus_unit == "N m", accept, rate_hz=recording.rate_hz)


def diagnose_lines(
    lines: Lines,
    nominal: Model,
    *,
    draws: int,
    refits: bool,
    seed: int = 0,
    name: str = "lines",
    labels: Labels | None = None,
    test: GapTest | None = None,
    asked: Asked = EVERYTHING,
    prior_none: float = NONE,
) -> Diagnosis:
    """Diagnosis of measured lines. ``nominal``: base model with values of the order of magnitude of a person's.

    ``labels``: what is known about the labels; with them, and a gap, mislabelling is among the possible causes.
    ``test``: the test of these lines with these settings, if it was made before. ``asked``, ``prior_none``: see
    `diagnose`.
    """
    t = test or gap_test(lines, nominal, draws, refits, seed)
    base, data, detection, compared = t.base, t.data, t.detection, t.contrasts
    detected = t.p_value < LEVEL
    explanation = explain(
        base,
        t.minima,
        data,
        t.effects,
        t.signatures,
        t.groups,
        t.scores,
        detection.unstructured,
        compared,
        partial(mislabelled, lines, base, t.minima, labels, seed) if detected and labels is not None else None,
        prior_none,
    )
    causes, near = explanation.causes, None
    if asked.nearest and detected and detection.p_value < LEVEL:
        causes = with_likeness(base, causes, data, _space(t.scores), detection, seed)
        near = nearest(base, causes, data, lines, seed)
    leading = causes[0] if detected and causes else None
    added = None if leading is None or leading.advice else leading
    closes = added if asked.closed and added is not None and added.changes(base) else None
    place, abstained = locations(explanation)
    trials = int(np.unique(lines.trial).size)
    belief = Belief(explanation.hypotheses, explanation.unknown, detection.null_chi2)
    return Diagnosis(
        name=name,
        detected=detected,
        p_value=t.p_value,
        p_least=t.p_least,
        place=place,
        place_abstained=abstained,
        causes=causes,
        none_probability=explanation.none,
        unknown_probability=explanation.unknown,
        credible_set=credible_set(explanation),
        closed=None if closes is None else _closed(base, closes, data, lines, t.scores, belief, seed),
        sway_rms_deg=_sway(base, added, data, lines),
        undetectable=undetectable(t.signatures, compared, trials),
        detection=detection,
        contrasts=tuple(compared),
        shifts=shifts(base, None if leading is None else leading.fitted),
        groups=tuple(t.groups),
        f=lines.f,
        torque=missing_torque(base, data),
        warnings=(*_other_axes(lines), *lines.notes),
        method={
            "null": "bootstrap with refits" if refits else "linearised",
            "draws": draws,
            "seed": seed,
            "trials": trials,
            "repeats": int(lines.repeats.shape[0]),
        },
        lines=lines,
        base=base,
        prior=prior(prior_none),
        none_log_factor=explanation.none_log_factor,
        hypotheses=explanation.hypotheses,
        nearest=near,
        asked=asked,
    )


def _other_axes(lines: Lines) -> list[str]:
    """Warning about power at even lines, which the stimulus does not excite but an even nonlinearity does."""
    if len(lines.parts) > 1:
        return list(dict.fromkeys(note for part in lines.parts for note in _other_axes(part)))
    if lines.even is None:
        return []
    ratio, p = lines.even.excess(0.02, 2.0)
    if not np.isfinite(p).all() or p.min() > 1e-3:
        return []
    return [
        f"power at even lines is {ratio[int(p.argmin())]:.2g} times the noise level ({p_words(p.min())}), "
        "which indicates an even nonlinearity"
    ]


def credible_set(explanation: Explanation) -> tuple[int | str, ...]:
    """Smallest set of causes (by index), "unknown" and "none" whose posterior probability is at least `CREDIBLE`."""
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
) -> Closure:
    return close(base, leading.fitted, data, lines, _space(scores), belief, stream(seed, "gap closed"))


def _space(scores: Scores) -> np.ndarray:
    """(4 N, M) columns that span the signatures of the library and the smooth deviations, of the shortest length."""
    shortest = scores.families[: len(scores.families) // len(LENGTHS)]
    return np.concatenate([*(s.vector[:, None] for s in scores.library), *(f.columns for f in shortest)], axis=1)


def _sway(base: Fitted, leading: Cause | None, data: Data, lines: Lines) -> dict[str, float | None]:
    if not np.isfinite(lines.power).all():
        return {"before": None, "after": None, "floor": None}
    return {
        "before": sway_rms_deg(base, data, lines),
        "after": None if leading is None else sway_rms_deg(leading.fitted, data, lines),
        "floor": floor_rms_deg(base if leading is None else leading.fitted, data, lines),
    }
