"""The outcome of a diagnosis as plain data, with what is computed of it when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.closure import Closure, noise_rms_deg
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.gap.questions.detection import Detection
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.questions.nearest import Nearest
from mcstudy.gap.questions.parameters import Shift
from mcstudy.gap.questions.posterior import Cause
from mcstudy.gap.questions.power import DetectionLimits, Undetectable
from mcstudy.gap.questions.question import Answer
from mcstudy.gap.settings import EVERYTHING, Asked, DiagnosisMethod
from mcstudy.lines.checked_recording import discarded
from mcstudy.lines.reading_fits import of_part
from mcstudy.recordings.joint_recording import AnyRecording, JointRecording, part_labels
from mcstudy.spectra.lines import Lines
from mcstudy.stance.joint import members
from mcstudy.streams import stream


@dataclass(frozen=True, repr=False)
class DiagnosisRecord:
    """Diagnosis of the gap between the body in one recording and the model.

    `mcstudy.diagnose` returns it with words, figures and a page (`mcstudy.results.diagnosis`).

    Attributes
    ----------
    name
        Name of the recording.
    detected
        Whether there is a gap, at the 5 % level.
    p_value
        p-value of that test.
    p_least
        Smallest p-value that is possible with this number of null samples.
    place
        Probability of each location: ankle, hip, stimulus, sensor, body, and recording (mislabelled); of a declared
        model its rows, stimulus and sensor.
    place_abstained
        Probability that is assigned to none of them.
    causes
        Named causes (`Cause`) by decreasing probability.
    none_probability
        Probability that no effect is missing.
    unknown_probability
        Probability of a cause outside the library.
    credible_set
        The smallest set of causes with a probability of 95 %: indices into ``causes``, or "unknown" and "none".
    closed
        Share of the gap that the leading cause closes (`Closure`); None where none is stated: without a gap, for a
        mislabelled recording, and for a cause that leaves the mean response unchanged.
    sway_rms_deg
        RMS error of predicted sway of the base model ("before") and with the leading cause ("after"), and its noise
        floor, deg; None where outputs are no angles in rad.
    detection
        Tests, residual map and bands (`Detection`).
    contrasts
        Comparisons between amplitudes, and of first and last cycles (`Contrast`).
    shifts
        Parameter estimates without and with the leading cause (`Shift`).
    groups
        Names of effects that this recording cannot distinguish, group by group.
    f
        (N,), frequencies of the lines, Hz.
    torque
        (N, R) complex, torque per stimulus by row that would close the gap; for illustration only.
    warnings
        Warnings about data quality.
    method
        Settings of the null distribution.
    lines
        The measured lines, with their noise.
    base
        The fit of the model without effects.
    prior
        Prior probabilities of the kinds of hypotheses (`mcstudy.gap.prior.prior`).
    none_log_factor
        ln Bayes factor of no missing effect against all others. With another prior p of no missing effect, its
        posterior odds are p / (1 - p) times this factor.
    recording
        The diagnosed recording; several of one kind are pooled, of different kinds they are a `JointRecording`. None
        for lines alone.
    hypotheses
        Every refitted hypothesis (`Hypothesis`) with its probability; those of ``causes`` are summed by group.
    nearest
        The nearest mechanism of the library, whatever the verdict, and what it leaves (`Nearest`). None without a gap
        in the mean response, or when no mechanism comes near with a size that a body can have.
    asked
        Which of the slow questions were answered (`Asked`); None in ``closed`` or ``nearest`` may mean not asked.
    answers
        Answers to further questions (`mcstudy.gap.questions.question.Answer`), in the order of the verdict.
    """

    name: str
    detected: bool
    p_value: float
    p_least: float
    place: dict[str, float]
    place_abstained: float
    causes: tuple[Cause, ...]
    none_probability: float
    unknown_probability: float
    credible_set: tuple[int | str, ...]
    closed: Closure | None
    sway_rms_deg: dict[str, float | None]
    detection: Detection
    contrasts: tuple[Contrast, ...]
    shifts: tuple[Shift, ...]
    groups: tuple[tuple[str, ...], ...]
    f: np.ndarray
    torque: np.ndarray
    warnings: tuple[str, ...]
    method: DiagnosisMethod
    lines: Lines
    base: Fitted
    prior: dict[str, float]
    none_log_factor: float
    recording: AnyRecording | None = None
    hypotheses: tuple[tuple[Hypothesis, float], ...] = field(default=(), repr=False)
    nearest: Nearest | None = None
    asked: Asked = EVERYTHING
    answers: tuple[Answer, ...] = ()

    @property
    def leading(self) -> Cause | None:
        """The most probable named cause, which was added to the model; None when no gap was detected."""
        return self.causes[0] if self.detected and self.causes else None

    @property
    def undetectable(self) -> tuple[Undetectable, ...]:
        """Effects that this recording could not have shown (`Undetectable`)."""
        return next((a.effects for a in self.answers if isinstance(a, DetectionLimits)), ())

    @property
    def added(self) -> Fitted | None:
        """The fit with the leading cause; None without a gap, or when that cause leaves the mean response unchanged."""
        leading = self.leading
        return leading.fitted if leading is not None and leading.changes(self.base) else None

    @cached_property
    def sway_noise_deg(self) -> tuple[float, float] | None:
        """Range of the error of predicted sway in 95 % of recordings with noise alone, deg; None without time series.

        It is that of the model with the leading cause, if one was added.
        """
        if self.sway_rms_deg["floor"] is None:
            return None
        fitted = self.base if self.added is None else self.added
        rng = stream(self.method.seed, "gap sway")
        return noise_rms_deg(fitted, Data.of(self.lines), self.lines, rng)

    @property
    def parts(self) -> tuple[Self, ...]:
        """The diagnosis as seen in each of its recordings: its lines, and the responses of both models to its stimulus.

        Whatever was concluded is that of all recordings. A single recording is its own part.
        """
        if len(self.lines.parts) == 1:
            return (self,)
        models, several = members(self.base.model), len(self.lines.parts)
        leading, out = self.leading, []
        for k, (lines, block) in enumerate(zip(self.lines.parts, self.lines.blocks, strict=True)):
            causes = self.causes
            if leading is not None:
                fitted = of_part(leading.fitted, block, members(leading.fitted.model)[k])
                causes = (replace(leading, fitted=fitted), *causes[1:])
            discard = self.method.discard
            out.append(
                replace(
                    self,
                    name=part_labels(self.recording, several)[k],
                    causes=causes,
                    detection=replace(self.detection, z=self.detection.z[block]),
                    f=self.f[block],
                    torque=self.torque[block],
                    lines=lines,
                    base=replace(self.base, model=models[k]),
                    nearest=self.nearest and self.nearest.of_part(k, block),
                    recording=self.recording.parts[k] if isinstance(self.recording, JointRecording) else None,
                    method=self.method if discard is None else replace(self.method, discard=discarded(discard, k)),
                )
            )
        return tuple(out)
