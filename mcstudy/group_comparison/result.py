"""What a comparison of two groups found, as text and as plain numbers."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mcstudy.files.schema import identifier
from mcstudy.group_comparison.changes import OTHER
from mcstudy.group_comparison.detection import Detection, name
from mcstudy.short_repr import Summary
from mcstudy.text_tables import fill, number, p_value, p_words, table

LEVEL = 0.05
"""Level of the test that decides, and of all others."""

COMPARABLE = 0.1
"""Share of the highest probability from which another change is named beside the most probable one."""

LEAST_SHOWN = 0.005
"""Hypotheses that are less probable are left out of the table, unless it would have fewer than five rows."""


@dataclass(frozen=True)
class Cause:
    """One hypothesis about what changed.

    Attributes
    ----------
    name: of the hypothesis. probability: given the data, that the means differ, and equal prior probabilities of the
    named changes.
    closed, closed_se: share of the difference that it closes in people who were not used for it, and its standard
    error; None where it was not computed. parameters: name, value in a, value in b.
    """

    name: str
    probability: float
    closed: float | None
    closed_se: float | None
    parameters: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True, repr=False)
class ComparisonRecord(Summary):
    """Two groups compared.

    Attributes
    ----------
    a, b: names of the groups. people: of each, the pairs if ``paired``. stimulus: its kind.
    f: (N,), Hz. mean_a, mean_b: (2, N) mean responses, lower and upper body in space. error_a, error_b: (2, N) their
    standard errors (root of E|error|^2). detection: tests. causes: by probability; only of a difference that was found.
    predicted: (2, N), difference that the best named change predicts. inflation: factor of the error of the difference
    in the evidence. Both are None where no difference was found. notes: what was left out of the recordings, and why.
    """

    a: str
    b: str
    people: tuple[int, int]
    paired: bool
    stimulus: str
    f: np.ndarray
    mean_a: np.ndarray
    mean_b: np.ndarray
    error_a: np.ndarray
    error_b: np.ndarray
    predicted: np.ndarray | None
    inflation: float | None
    permutations: int
    detection: Detection
    causes: tuple[Cause, ...]
    notes: tuple[str, ...] = ()

    @property
    def differs(self) -> bool:
        """Whether a difference of the mean responses was found at the 5 % level: the decision."""
        return self.detection.p_mean <= LEVEL

    @property
    def kind(self) -> str:
        """``"same"``, ``"alike"`` (both segments change by one factor) or ``"upper body"`` (their ratio changes)."""
        return name(self.detection, LEVEL)

    @property
    def best(self) -> Cause | None:
        """The most probable named change; None where no difference was found."""
        return next((c for c in self.causes if c.name != OTHER), None)

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            (
                "groups",
                f"{self.a} ({self.people[0]}), {self.b} ({self.people[1]}), {'' if self.paired else 'un'}paired",
            ),
            ("difference", f"{self.kind} ({self._p(self.detection.p_mean, 'p of equal means')})"),
            ("cause", self.best.name if self.best else "none"),
        ]

    def verdict(self) -> str:
        """The answer in a few sentences."""
        d = self.detection
        who = (
            f"{self.people[0]} people, each in both" if self.paired else f"{self.people[0]} and {self.people[1]} people"
        )
        means = f"{self._p(d.p_mean, 'p of equal means')}, {d.relabellings} relabellings, {who}"
        if not self.differs:
            parts = [
                f"No difference between the mean responses of {self.a} and {self.b} was found ({means}). Not found "
                "does not mean that there is none."
            ]
            if d.least_p > LEVEL:
                parts.append(
                    f"So few people cannot show one: the smallest p-value of their relabellings is {d.least_p:.2g}, "
                    f"above {LEVEL:g}."
                )
            return " ".join([*parts, *self._scatter()])
        parts = [f"{self.b} differs from {self.a} in its mean responses ({means})."]
        places = [r for r in d.regions if r.p <= LEVEL]
        if places:
            words = [f"{r.segment} body, {r.low:.3g} to {r.high:.3g} Hz (gain x {r.gain:.2f})" for r in places]
            parts.append(f"It is in the {'; '.join(words)}.")
        else:
            parts.append("Which band of which segment it is in is not told.")
        if self.kind == "alike":
            parts.append(
                "Upper body relative to lower body: no change found "
                f"({self._p(d.p_ratio, 'p of equal ratios')}), as when the ankle loop or the weight "
                "of the sensed stimulus changes."
            )
        else:
            parts.append(
                "The upper body moves differently relative to the lower body "
                f"({self._p(d.p_ratio, 'p of equal ratios')}), as when the control of the upper body "
                "changes, for example with vision."
            )
        return " ".join([*parts, *self._scatter(), self._cause()])

    def _scatter(self) -> list[str]:
        """What the test of scatter says, which is no test of the means."""
        d = self.detection
        if d.p_scatter > LEVEL:
            return []
        return [
            f"A question of its own: the variance between people is {d.scatter_ratio:.2f} times as large "
            f"({self._p(d.p_scatter, 'p of equal scatter')}); noise of FRFs falls with the amplitude of the stimulus."
        ]

    def _p(self, p: float, name: str) -> str:
        """``name = 0.03``, or a limit where no other relabelling that was drawn is as extreme."""
        return p_words(p, 1 / self.detection.relabellings, name)

    def _cause(self) -> str:
        best, other = self.best, next((c for c in self.causes if c.name == OTHER), None)
        if best is None:
            return ""
        if other is not None and other.probability > best.probability:
            return (
                f"None of the named changes of parameters is probable ({OTHER}: {other.probability:.0%}); the most "
                f"probable of them is {best.name}{_closed(best)}."
            )
        named = [c for c in self.causes if c.name != OTHER]
        near = [c for c in named[1:] if c.probability > best.probability * COMPARABLE]
        others = "".join(f"; {c.name} ({c.probability:.0%}){_closed(c)}" for c in near)
        return f"Most probable change: {best.name} ({best.probability:.0%}){_closed(best)}{others}."

    def text(self) -> str:
        """Verdict and tables."""
        regions = [
            [
                f"{r.segment} {r.band}",
                f"{r.low:.3g} to {r.high:.3g}",
                f"{r.gain:.2f}",
                f"{r.phase_deg:.0f}",
                p_value(r.p, 1 / self.detection.relabellings),
            ]
            for r in self.detection.regions
        ]
        shown = [c for k, c in enumerate(self.causes) if k < 5 or c.probability >= LEAST_SHOWN]
        causes = [
            [
                c.name,
                f"{100 * c.probability:.1f}",
                "-" if c.closed is None else f"{100 * c.closed:.0f} ± {100 * (c.closed_se or 0):.0f}",
                ", ".join(f"{n} {number(a)} to {number(b)}" for n, a, b in c.parameters) or "-",
            ]
            for c in shown
        ]
        d = self.detection
        tests = [
            ["equal means of all points (decides)", f"{d.p_mean:.3f}"],
            ["equal ratio of upper to lower body", f"{d.p_ratio:.3f}"],
            ["equal scatter between people", f"{d.p_scatter:.3f}"],
        ]
        blocks = [
            fill(self.verdict()),
            *(fill(note) for note in self.notes),
            f"Tests: {d.relabellings} relabellings, smallest p possible {d.least_p:.2g}\n\n"
            + table(["what is tested", "p"], tests),
            f"Where: {self.b} relative to {self.a}, p of equal means in a region, corrected for all regions\n\n"
            + table(["segment, band", "Hz", "gain ratio", "phase (deg)", "p"], regions),
            "What: changes of parameters by probability, given that the means differ, and share closed in people not "
            "used for the\nestimate\n\n"
            + table(["change", "probability (%)", "closed (%)", f"from {self.a} to {self.b}"], causes)
            if causes
            else "What: no change of a parameter is named, because no difference of the means was found.",
        ]
        return "\n\n".join(blocks)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, described in results_schema."""

        def parts(H: np.ndarray | None) -> dict[str, Any] | None:
            return None if H is None else {"real": H.real.tolist(), "imaginary": H.imag.tolist()}

        return {
            "schema": identifier("comparison"),
            "a": self.a,
            "b": self.b,
            "people": list(self.people),
            "paired": self.paired,
            "stimulus": self.stimulus,
            "permutations": self.permutations,
            "inflation": self.inflation,
            "verdict": self.verdict(),
            "notes": list(self.notes),
            "kind": self.kind,
            "frequency": self.f.tolist(),
            "mean_a": parts(self.mean_a),
            "mean_b": parts(self.mean_b),
            "error_a": self.error_a.tolist(),
            "error_b": self.error_b.tolist(),
            "predicted_difference": parts(self.predicted),
            "detection": {**asdict(self.detection), "regions": [asdict(r) for r in self.detection.regions]},
            "causes": [
                {
                    "name": c.name,
                    "probability": c.probability,
                    "closed": c.closed,
                    "closed_se": c.closed_se,
                    "parameters": [{"name": n, "a": a, "b": b} for n, a, b in c.parameters],
                }
                for c in self.causes
            ],
        }


def _closed(cause: Cause) -> str:
    if cause.closed is None or cause.closed_se is None or not math.isfinite(cause.closed):
        return ""
    return f", which closes {100 * cause.closed:.0f} ± {100 * cause.closed_se:.0f} % of it in people not used for it"
