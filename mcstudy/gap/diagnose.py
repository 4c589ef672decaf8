"""Diagnosis of a recording: where the model fails, which effect is missing, and how much of the gap it closes.

A recording is checked, its labels are settled and its cycles chosen; its lines are measured, the base model is fitted
to them and tested, and the questions are answered from this test.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import LENGTHS
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.prior import prior
from mcstudy.gap.questions.any_gap import GapTest, gap_test
from mcstudy.gap.questions.closure import Belief, Closure, close, floor_rms_deg, sway_rms_deg
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.gap.questions.location import locations, missing_torque
from mcstudy.gap.questions.mislabelling import Labels, mislabelled
from mcstudy.gap.questions.nearest import nearest, with_likeness
from mcstudy.gap.questions.parameters import shifts
from mcstudy.gap.questions.posterior import Cause, explain
from mcstudy.gap.questions.power import detection_limits
from mcstudy.gap.questions.question import Answer, Inquiry
from mcstudy.gap.settings import DiagnosisMethod, DiagnosisSettings
from mcstudy.lines.base_fit import BaseFit, base_fit
from mcstudy.lines.checked_recording import CheckedRecording
from mcstudy.lines.labels import label_odds
from mcstudy.lines.settling import settled
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import AnyRecording, JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream
from mcstudy.text_tables import p_words

QUESTIONS: tuple[Callable[[Inquiry], Answer | None], ...] = (detection_limits,)
"""Further questions, in the order of the verdict: each is a file of `mcstudy.gap.questions`."""


def diagnose(
    recordings: AnyRecording | Sequence[Recording | FrfRecording], settings: DiagnosisSettings
) -> DiagnosisRecord:
    """Diagnosis of one recording, or of several of the same person.

    Those with the same stimulus, period and sampling rate are pooled, others diagnosed together, each with the noise
    that was measured in it.

    Raises `RecordingError` for a recording that cannot be analysed or whose channels are mislabelled.
    """
    checked, fit = _fitted(recordings, settings)
    test = gap_test(checked.lines, fit, settings)
    labels = _labels(checked, settings)
    diagnosis = _answers(checked.lines, test, settings, checked.recording.name, labels)
    return replace(
        diagnosis,
        recording=checked.recording,
        warnings=(*checked.warnings, *diagnosis.warnings),
        method=replace(diagnosis.method, fmax=checked.fmax, discard=checked.discard),
    )


def detect(recordings: AnyRecording | Sequence[Recording | FrfRecording], settings: DiagnosisSettings) -> GapTest:
    """Only the test for a gap, identical to that of `diagnose`, in half the time or less."""
    checked, fit = _fitted(recordings, settings)
    return gap_test(checked.lines, fit, settings)


def diagnose_lines(lines: Lines, nominal: Model, settings: DiagnosisSettings) -> DiagnosisRecord:
    """Diagnosis of measured lines. ``nominal``: base model with values of the order of magnitude of a person's."""
    return _answers(lines, gap_test(lines, base_fit(lines, nominal, settings.seed), settings), settings)


def _fitted(
    recordings: AnyRecording | Sequence[Recording | FrfRecording], settings: DiagnosisSettings
) -> tuple[CheckedRecording, BaseFit]:
    """The checked recording without the cycles in which it settles, and the fit of the base model to its lines."""
    return settled(recordings, settings, lambda checked: base_fit(checked.lines, checked.nominal, settings.seed))


def _answers(
    lines: Lines, test: GapTest, settings: DiagnosisSettings, name: str = "lines", labels: Labels | None = None
) -> DiagnosisRecord:
    """The answers to all questions, from the ``test`` of the ``lines``.

    ``labels``: what is known about the labels; with them, and a gap, mislabelling is among the possible causes.
    """
    base, data, minima, seed = test.fit.best, test.fit.data, test.fit.minima, settings.seed
    detection, compared, asked = test.detection, test.contrasts, settings.asked
    detected = test.p_value < LEVEL
    readings = partial(mislabelled, lines, base, minima, labels, seed) if detected and labels is not None else None
    explanation = explain(test, readings, settings.prior_none)
    causes, near = explanation.causes, None
    if asked.nearest and detected and detection.p_value < LEVEL:
        causes = with_likeness(base, causes, data, _space(test.scores), detection, seed)
        near = nearest(base, causes, data, lines, seed)
    inquiry = Inquiry(lines, test, explanation, causes, detected, settings)
    leading = inquiry.leading
    added = None if leading is None or leading.advice else leading
    closes = added if asked.closed and added is not None and added.changes(base) else None
    place, abstained = locations(explanation, base.model)
    trials = int(np.unique(lines.trial).size)
    belief = Belief(explanation.hypotheses, explanation.unknown, detection.null_chi2)
    return DiagnosisRecord(
        name=name,
        detected=detected,
        p_value=test.p_value,
        p_least=test.p_least,
        place=place,
        place_abstained=abstained,
        causes=causes,
        none_probability=explanation.none,
        unknown_probability=explanation.unknown,
        credible_set=inquiry.credible_set,
        closed=None if closes is None else _closed(base, closes, data, lines, test.scores, belief, seed),
        sway_rms_deg=_sway(base, added, data, lines),
        detection=detection,
        contrasts=tuple(compared),
        shifts=shifts(base, None if leading is None else leading.fitted),
        groups=tuple(test.groups),
        f=lines.f,
        torque=missing_torque(base, data),
        warnings=(*_other_axes(lines), *lines.notes),
        method=DiagnosisMethod(
            null="linearised" if settings.fast else "bootstrap with refits",
            draws=settings.draws,
            seed=seed,
            trials=trials,
            repeats=int(lines.repeats.shape[0]),
        ),
        lines=lines,
        base=base,
        prior=prior(settings.prior_none),
        none_log_factor=explanation.none_log_factor,
        hypotheses=explanation.hypotheses,
        nearest=near,
        asked=asked,
        answers=tuple(answer for ask in QUESTIONS if (answer := ask(inquiry)) is not None),
    )


def _labels(checked: CheckedRecording, settings: DiagnosisSettings) -> Labels | None:
    """What the nominal model says of the labels; None for responses, and of what no standing body is in."""
    if isinstance(checked.recording, FrfRecording) or not standing(checked.nominal):
        return None
    accepted = frozenset(settings.accept)

    def of_part(recording: Recording, lines: Lines, name: str = "") -> Labels:
        odds, torque = label_odds(recording, lines), recording.stimulus_unit == "N m"
        return Labels(odds, torque, accepted, name, rate_hz=recording.rate_hz)

    recording, lines = checked.recording, checked.lines
    if isinstance(recording, JointRecording):
        return Labels.joined([*map(of_part, recording.parts, lines.parts, recording.labels)])
    assert isinstance(recording, Recording)
    return of_part(recording, lines)


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


def _closed(
    base: Fitted, leading: Cause, data: Data, lines: Lines, scores: Scores, belief: Belief, seed: int
) -> Closure:
    return close(base, leading.fitted, data, lines, _space(scores), belief, stream(seed, "gap closed"))


def _space(scores: Scores) -> np.ndarray:
    """(4 N, M) columns that span the signatures of the library and the smooth deviations, of the shortest length."""
    shortest = scores.families[: len(scores.families) // len(LENGTHS)]
    return np.concatenate([*(s.vector[:, None] for s in scores.library), *(f.columns for f in shortest)], axis=1)


def _sway(base: Fitted, leading: Cause | None, data: Data, lines: Lines) -> dict[str, float | None]:
    if not np.isfinite(lines.power).all() or set(base.model.output_units) != {"rad"}:
        return {"before": None, "after": None, "floor": None}
    return {
        "before": sway_rms_deg(base, data, lines),
        "after": None if leading is None else sway_rms_deg(leading.fitted, data, lines),
        "floor": floor_rms_deg(base if leading is None else leading.fitted, data, lines),
    }
