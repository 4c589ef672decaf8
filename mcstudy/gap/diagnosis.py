"""The outcome of a diagnosis: a frozen object, its JSON form and its paragraph in plain words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mcstudy.gap.ambiguity import Undetectable
from mcstudy.gap.close import Closed
from mcstudy.gap.contrasts import Contrast
from mcstudy.gap.detect import Detection
from mcstudy.gap.explain import Cause
from mcstudy.gap.fitting import Fitted
from mcstudy.gap.summary import Summary, shortened
from mcstudy.study import schema

LEVEL = 0.05
"""Probability of a false alarm."""


MOSTLY_PRIOR = 0.7
"""Standard deviation of a parameter, relative to that of its prior, from which the data said less than the prior."""

SOURCES = {"data": "", "prior": "mostly prior", "bound": "at bound"}
"""Where the value of a parameter comes from, and how a table says it."""

SOURCES_EXPLAINED = (
    f"mostly prior: the standard error is at least {MOSTLY_PRIOR:g} of that of the prior, so the value is the prior's "
    "more than the data's; at bound: the fit ends on a bound, so the standard error says little."
)


def sources(fitted: Fitted) -> tuple[str, ...]:
    """Per parameter of a fit, a key of `SOURCES`."""
    model, prior = fitted.model, fitted.prior
    share = np.sqrt(np.diag(fitted.covariance)) / prior.scale
    near = 1e-6 * (model.upper - model.lower)
    on_bound = (fitted.theta <= model.lower + near) | (fitted.theta >= model.upper - near)
    return tuple(
        "bound" if bound else "prior" if s >= MOSTLY_PRIOR else "data" for bound, s in zip(on_bound, share, strict=True)
    )


@dataclass(frozen=True)
class Shift:
    """A base parameter with and without the leading cause: estimates and standard errors in ``unit``.

    ``without_from``, ``added_from``: where the values come from, keys of `SOURCES`.
    """

    name: str
    unit: str
    without: float
    without_se: float
    added: float | None
    added_se: float | None
    without_from: str = "data"
    added_from: str | None = None

    @property
    def source(self) -> str:
        """In words: of the fit with the leading cause, of the other where they differ or there is none."""
        own = SOURCES[self.without_from]
        if self.added_from is None or self.added_from == self.without_from:
            return own
        return f"{own or 'data'}; with the cause {SOURCES[self.added_from] or 'data'}"


@dataclass(frozen=True, repr=False)
class Diagnosis(Summary):
    """What one recording says about the gap between its body and the model.

    Attributes
    ----------
    name: of the recording. detected: whether there is a gap at the 5 % level; p_value: of that test; p_least: the least
        it could be with these draws.
    place: probability of ankle, hip, stimulus, sensor, body; place_abstained: what is given to none of them.
    causes: named causes by falling probability, each an ambiguity group; none_probability, unknown_probability: that
        nothing is missing, that the cause is not in the library.
    credible_set: the smallest set of causes, "unknown" and "none" that holds 95 %, as indices into ``causes`` or words.
    closed: share of the gap that the leading cause closes (None without a gap). sway_rms_deg: error of predicted sway
        before, after and at the noise floor, deg. undetectable: what these data cannot speak about.
    detection: tests, residual map and bands. contrasts: amplitude and time. shifts: parameters. groups: effects that
        this recording cannot tell apart. f: lines, Hz. torque: (N, 2) missing torque by row (hip, ankle), a picture.
    warnings: what is odd about the recording. method: how the null was found.
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
    closed: Closed | None
    sway_rms_deg: dict[str, float | None]
    undetectable: tuple[Undetectable, ...]
    detection: Detection
    contrasts: tuple[Contrast, ...]
    shifts: tuple[Shift, ...]
    groups: tuple[tuple[str, ...], ...]
    f: np.ndarray = field(repr=False)
    torque: np.ndarray = field(repr=False)
    warnings: tuple[str, ...]
    method: dict[str, Any]

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        from mcstudy.gap.verdict import p_words, words

        found = "a gap beyond noise" if self.detected else "no gap beyond noise"
        causes = [(c.probability, words(" and ".join(c.effects))) for c in self.causes]
        causes += [
            (self.unknown_probability, "a cause outside the library"),
            (self.none_probability, "no missing effect"),
        ]
        leading = sorted(causes, reverse=True)[:4]
        place = max(self.place, key=lambda k: self.place[k])
        facts = [
            ("name", shortened(self.name)),
            ("verdict", f"{found} ({p_words(self.p_value, self.p_least)})"),
            ("causes", "; ".join(f"{name} {100 * p:.0f} %" for p, name in leading)),
            ("place", f"{place} {100 * self.place[place]:.0f} %"),
        ]
        if self.closed is not None:
            c = self.closed
            facts.append(("closed", f"{100 * c.fraction:.0f} % [{100 * c.low:.0f}, {100 * c.high:.0f}] of the gap"))
        if self.warnings:
            facts.append(("notes", shortened("; ".join(self.warnings), 600)))
        return [*facts, ("more", "verdict(), to_dict()")]

    def verdict(self) -> str:
        """One paragraph in plain words."""
        from mcstudy.gap.verdict import verdict

        return verdict(self)

    def _repr_html_(self) -> str:
        from mcstudy.gap.verdict import html

        return html(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data, valid under ``results_schema/1.0.0/diagnosis.json``."""
        d = self.detection
        return _plain(
            {
                "schema": schema.identifier("diagnosis"),
                "name": self.name,
                "verdict": self.verdict(),
                "detected": self.detected,
                "p_value": self.p_value,
                "place": self.place,
                "place_abstained": self.place_abstained,
                "causes": [
                    {
                        "effects": list(c.effects),
                        "alternatives": [list(a) for a in c.alternatives],
                        "probability": c.probability,
                        "size": {
                            s.name: {"estimate": s.estimate, "se": s.se, "low": s.low, "high": s.high, "unit": s.unit}
                            for s in c.sizes
                        },
                    }
                    for c in self.causes
                    if c.probability > 1e-4 or c is self.causes[0]
                ],
                "none_probability": self.none_probability,
                "unknown_probability": self.unknown_probability,
                "credible_set": [
                    {"cause": k} if isinstance(k, str) else {"cause": "named", "effects": list(self.causes[k].effects)}
                    for k in self.credible_set
                ],
                "closed": None
                if self.closed is None
                else {
                    "fraction": self.closed.fraction,
                    "low": self.closed.low,
                    "high": self.closed.high,
                    "at_noise_floor": self.closed.at_noise_floor,
                    "energy_before": self.closed.before,
                    "energy_after": self.closed.after,
                    "trials_needed": self.closed.trials_needed,
                },
                "sway_rms_deg": self.sway_rms_deg,
                "undetectable": [
                    {
                        "effect": u.effect,
                        "reason": u.reason,
                        "size_needed": u.size_needed,
                        "unit": u.unit,
                        "trials_needed": u.trials_needed,
                    }
                    for u in self.undetectable
                ],
                "fit": {
                    "chi2": d.chi2,
                    "expected": d.expected_chi2,
                    "p_value": d.fit_p_value,
                    "lines": len(self.f),
                },
                "bands": [
                    {
                        "angle": b.angle,
                        "low_hz": b.low_hz,
                        "high_hz": b.high_hz,
                        "level": b.level,
                        "limit": b.limit,
                        "beyond": b.beyond,
                    }
                    for b in d.bands
                ],
                "z_map": {"f": self.f, "theta1": np.abs(d.z[:, 0]), "theta2": np.abs(d.z[:, 1]), "limit": d.z_limit},
                "contrasts": [
                    {
                        "kind": c.kind,
                        "between": list(c.between),
                        "p_value": c.p_value,
                        "changes": [{"effect": k.effect, "gain": k.gain, "se": k.se, "z": k.z} for k in c.changes],
                    }
                    for c in self.contrasts
                ],
                "parameters": [
                    {
                        "name": s.name,
                        "unit": s.unit,
                        "without": s.without,
                        "without_se": s.without_se,
                        "added": s.added,
                        "added_se": s.added_se,
                        "without_from": s.without_from,
                        "added_from": s.added_from,
                    }
                    for s in self.shifts
                ],
                "groups": [list(g) for g in self.groups],
                "warnings": list(self.warnings),
                "method": self.method,
            }
        )


def _plain(x: Any) -> Any:
    """Builtin types only; numbers that are not finite become null."""
    if isinstance(x, dict):
        return {str(k): _plain(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [_plain(v) for v in x]
    if isinstance(x, np.ndarray):
        return _plain(x.tolist())
    if isinstance(x, np.generic):
        return _plain(x.item())
    if isinstance(x, float) and not math.isfinite(x):
        return None
    return x
