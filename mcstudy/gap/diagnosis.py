"""The outcome of a diagnosis: a frozen object, its JSON form and its summary as text."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap import nearest_words, tables, verdict
from mcstudy.gap.questions.closure import Closure, noise_rms_deg
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.gap.questions.detection import Detection
from mcstudy.gap.questions.evidence import Hypothesis
from mcstudy.gap.questions.nearest import SHOWN, Nearest
from mcstudy.gap.questions.parameters import Shift
from mcstudy.gap.questions.posterior import Cause
from mcstudy.gap.questions.power import DetectionLimits, Undetectable
from mcstudy.gap.questions.question import Answer
from mcstudy.gap.settings import EVERYTHING, Asked, DiagnosisMethod
from mcstudy.lines.checked_recording import discarded
from mcstudy.lines.part_fits import parts_dict
from mcstudy.lines.reading_fits import of_part
from mcstudy.recordings.joint_recording import AnyRecording, JointRecording, part_labels
from mcstudy.short_repr import Summary, shortened
from mcstudy.spectra.lines import Lines
from mcstudy.stance.joint import members
from mcstudy.streams import stream

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, repr=False)
class DiagnosisRecord(Summary):
    """Diagnosis of the gap between the body in one recording and the model.

    `mcstudy.diagnose` returns one with figures (``plot``) and a page (``to_html``).

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
        Probability of each location: ankle, hip, stimulus, sensor, body, and recording (mislabelled).
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
        floor, deg.
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
        (N, 2) complex, torque per stimulus by row (hip, ankle) that would close the gap; for illustration only.
    warnings
        Warnings about data quality.
    method
        Settings of the null distribution.
    lines
        The measured lines, with their noise.
    base
        The fit of the model without effects.
    prior
        Prior probabilities of the kinds of hypotheses (`mcstudy.gap.questions.posterior.prior`).
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

    more: ClassVar[str] = "verdict(), to_xarray(), to_dict()"
    """Further methods, named in the representation at a prompt."""

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
                own = of_part(leading.fitted, block, members(leading.fitted.model)[k])
                causes = (replace(leading, fitted=own), *causes[1:])
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

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        found = "a gap beyond noise" if self.detected else "no gap beyond noise"
        causes = [(c.probability, verdict.effects_of(c)) for c in self.causes]
        causes += [
            (self.unknown_probability, "a cause outside the library"),
            (self.none_probability, "no missing effect"),
        ]
        leading = sorted(causes, reverse=True)[:4]
        place = max(self.place, key=lambda k: self.place[k])
        facts = [
            ("name", shortened(self.name)),
            ("verdict", f"{found} ({verdict.p_words(self.p_value, self.p_least)})"),
            ("causes", "; ".join(f"{name} {nearest_words.chance(p)}" for p, name in leading)),
            ("location", f"{place} {nearest_words.chance(self.place[place])}"),
        ]
        if self.closed is not None:
            c = self.closed
            facts.append(("closed", f"{100 * c.fraction:.0f} % [{100 * c.low:.0f}, {100 * c.high:.0f}] of the gap"))
        if self.warnings:
            facts.append(("notes", shortened("; ".join(self.warnings), 600)))
        return [*facts, ("more", self.more)]

    def verdict(self) -> str:
        """Summary of the diagnosis in one paragraph."""
        return verdict.verdict(self)

    def _repr_html_(self) -> str:
        return f"<h3>{escape(self.name)}</h3><p>{escape(self.verdict())}</p>{tables.html(self)}"

    def to_xarray(self) -> xr.Dataset:
        """Responses, residuals, causes with probability and likeness, and the torque that the nearest one leaves.

        Dims ``line`` (with coordinate ``frequency``), ``angle``, ``cause`` and ``quantile``; units are attributes.
        """
        from mcstudy.gap.dataset import dataset  # xarray is slow to import, and a verdict does not need it

        return dataset(self)

    def to_dict(self) -> dict[str, Any]:
        """All results as plain JSON data, valid under ``results_schema/1.1.0/diagnosis.json``."""
        d, closed, answers = self.detection, self.closed, {a.name: a.to_dict() for a in self.answers}
        return plain(
            {
                "schema": schema.identifier("diagnosis"),
                "name": self.name,
                "verdict": self.verdict(),
                **_of(self, "detected p_value place place_abstained"),
                "causes": [
                    {
                        **_of(c, "effects alternatives probability"),
                        "size": {s.name: _of(s, "estimate se low high unit") for s in c.sizes},
                        **({"advice": c.advice} if c.advice else {}),
                        "likeness": c.likeness and asdict(c.likeness),
                    }
                    for c in self.causes
                    if c.probability > SHOWN or c is self.causes[0]
                ],
                "nearest": self.nearest and _nearest(self.nearest),
                **_of(self, "none_probability unknown_probability"),
                "prior": self.prior,
                "none_log_bayes_factor": self.none_log_factor,
                "credible_set": [
                    {"cause": k} if isinstance(k, str) else {"cause": "named", "effects": self.causes[k].effects}
                    for k in self.credible_set
                ],
                "closed": closed
                and {
                    **_of(closed, "fraction low high at_noise_floor"),
                    "energy_before": closed.before,
                    "energy_after": closed.after,
                    "trials_needed": closed.trials_needed,
                },
                "sway_rms_deg": self.sway_rms_deg,
                "sway_noise_deg": self.sway_noise_deg,
                "undetectable": answers.pop(DetectionLimits.name, []),
                "fit": {
                    "chi2": d.chi2,
                    "expected": d.expected_chi2,
                    "p_value": d.fit_p_value,
                    "lines": len(self.f),
                    "noise": d.chi2_noise,
                    "added_chi2": None if self.added is None else self.added.chi2,
                },
                "evidence": {"log_factor": d.statistic, "limit": d.statistic_limit, "p_value": d.p_value},
                "bands": [_of(b, "angle low_hz high_hz level limit beyond") for b in d.bands],
                "z_map": {"f": self.f, "theta1": np.abs(d.z[:, 0]), "theta2": np.abs(d.z[:, 1]), "limit": d.z_limit},
                "contrasts": [
                    {**_of(c, "kind between p_value"), "changes": [_of(k, "effect gain se z") for k in c.changes]}
                    for c in self.contrasts
                ],
                "parameters": [
                    _of(s, "name unit without without_se added added_se without_from added_from") for s in self.shifts
                ],
                **_of(self, "groups warnings"),
                "method": self.method.to_dict(),
                **parts_dict(part_labels(self.recording, len(d.parts)), d.parts),
                **({"answers": answers} if answers else {}),
            }
        )


def _nearest(near: Nearest) -> dict[str, Any]:
    """The nearest mechanism and what it leaves."""
    c, left = near.cause, near.remaining
    return {
        **_of(c, "effects alternatives probability"),
        "likeness": c.likeness and asdict(c.likeness),
        "chi2": near.chi2,
        "bands": [_of(b, "angle low_hz high_hz level limit beyond") for b in near.bands],
        "remaining": {
            **_of(left, "row sense probability path_probability poles poles_weight unit numerator denominator"),
            "rms": left.rms and asdict(left.rms),
            "share": left.share and asdict(left.share),
            **_of(left, "clearest_hz chi2 f gain gain_low gain_high phase phase_low phase_high"),
        },
    }


def _of(record: object, names: str) -> dict[str, Any]:
    """Some attributes of a record, under their names."""
    return {name: getattr(record, name) for name in names.split()}
