"""What a comparison of two groups found, as text and as plain numbers."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mcstudy.files.schema import identifier
from mcstudy.group_comparison.changes import NOTHING, OTHER
from mcstudy.group_comparison.detection import Detection, name
from mcstudy.short_repr import Summary
from mcstudy.text_tables import fill, number, table

LEVEL = 0.05
"""Level of the tests."""

COMPARABLE = 0.1
"""Share of the highest probability from which another change is named beside the most probable one."""

LEAST_SHOWN = 0.005
"""Hypotheses that are less probable are left out of the table, unless it would have fewer than five rows."""


@dataclass(frozen=True)
class Cause:
    """One hypothesis about what changed.

    Attributes
    ----------
    name: of the hypothesis. probability: given the data and equal prior probabilities of the named changes.
    closed, closed_se: share of the difference that it closes in people who were not used for it, and its standard
    error; None where it was not computed. parameters: name, value in a, value in b.
    """

    name: str
    probability: float
    closed: float | None
    closed_se: float | None
    parameters: tuple[tuple[str, float, float], ...]


@dataclass(frozen=True, repr=False)
class Comparison(Summary):
    """Two groups compared.

    Attributes
    ----------
    a, b: names of the groups. people: of each, the pairs if ``paired``. stimulus: its kind.
    f: (N,), Hz. mean_a, mean_b: (2, N) mean responses, lower and upper body in space. error_a, error_b: (2, N) their
    standard errors (root of E|error|^2). predicted: (2, N), difference that the best named change predicts, or None.
    inflation: factor of the error of the difference in the evidence. detection: tests. causes: by probability.
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
    inflation: float
    permutations: int
    detection: Detection
    causes: tuple[Cause, ...]

    @property
    def differs(self) -> bool:
        """Whether a difference was found at the 5 % level."""
        return self.detection.p <= LEVEL

    @property
    def kind(self) -> str:
        """``"same"``, ``"alike"`` (both segments change by one factor) or ``"upper body"`` (their ratio changes)."""
        return name(self.detection, LEVEL)

    @property
    def best(self) -> Cause | None:
        """The most probable named change."""
        return next((c for c in self.causes if c.name not in (NOTHING, OTHER)), None)

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            (
                "groups",
                f"{self.a} ({self.people[0]}), {self.b} ({self.people[1]}), {'' if self.paired else 'un'}paired",
            ),
            ("difference", f"{self.kind} (p = {self.detection.p:.3g})"),
            ("cause", self.best.name if self.differs and self.best else "none"),
        ]

    def verdict(self) -> str:
        """The answer in a few sentences."""
        d = self.detection
        who = (
            f"{self.people[0]} people, each in both" if self.paired else f"{self.people[0]} and {self.people[1]} people"
        )
        if not self.differs:
            return (
                f"No difference between {self.a} and {self.b} was found (p = {d.p:.2g}, {self.permutations} "
                f"relabellings, {who}). Not found does not mean that there is none."
            )
        parts = [f"{self.b} differs from {self.a} (p {_p(d.p, self.permutations)}, {who})."]
        places = [r for r in d.regions if r.p <= LEVEL]
        if places:
            words = [f"{r.segment} body, {r.low:.3g} to {r.high:.3g} Hz (gain x {r.gain:.2f})" for r in places]
            parts.append(f"It is in the {'; '.join(words)}.")
        else:
            parts.append("No single band of one segment differs by itself.")
        if self.kind == "alike":
            parts.append(
                f"Upper body relative to lower body: no change found (p = {d.p_ratio:.2g}), as when the ankle loop or "
                "the weight of the sensed stimulus changes."
            )
        else:
            parts.append(
                f"The upper body moves differently relative to the lower body (p {_p(d.p_ratio, self.permutations)}), "
                "as when the control of the upper body changes, for example with vision."
            )
        if d.p_scatter <= LEVEL:
            parts.append(
                f"The variance between people is {d.scatter_ratio:.2f} times as large (p "
                f"{_p(d.p_scatter, self.permutations)}); noise of FRFs falls with the amplitude of the stimulus."
            )
        parts.append(self._cause())
        return " ".join(parts)

    def _cause(self) -> str:
        best, other = self.best, next((c for c in self.causes if c.name == OTHER), None)
        if best is None or not self.causes:
            return ""
        if other is not None and other.probability > best.probability:
            return (
                f"None of the named changes of parameters is probable ({OTHER}: {other.probability:.0%}); the most "
                f"probable of them is {best.name}{_closed(best)}."
            )
        named = [c for c in self.causes if c.name not in (NOTHING, OTHER)]
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
                f"{r.p:.3f}",
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
        blocks = [
            fill(self.verdict()),
            f"Where: {self.b} relative to {self.a}, p corrected for all regions\n\n"
            + table(["segment, band", "Hz", "gain ratio", "phase (deg)", "p"], regions),
            "What: changes of parameters by probability, and share closed in people not used for the estimate\n\n"
            + table(["change", "probability (%)", "closed (%)", f"from {self.a} to {self.b}"], causes),
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


def _p(p: float, permutations: int) -> str:
    """``= 0.03``, or a limit where no relabelling was as extreme."""
    least = 1 / (permutations + 1)
    return f"<= {least:.3g}" if p <= least * (1 + 1e-9) else f"= {p:.2g}"


def _closed(cause: Cause) -> str:
    if cause.closed is None or cause.closed_se is None or not math.isfinite(cause.closed):
        return ""
    return f", which closes {100 * cause.closed:.0f} ± {100 * cause.closed_se:.0f} % of it in people not used for it"
