"""The design of a challenge: numbers of cases by kind, recordings, effects, sizes and noise.

`mcstudy_challenge.challenge_file` reads it. This module also limits single numbers. The limits are far from any real
recording and keep squares and ratios of the numbers within the range of floating point.
"""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Literal

from pydantic import Field, model_validator

from mcstudy.stance.noise import SensorNoise
from mcstudy.study.design import Name, Positive, Section

MAIN = "main"
"""Name of the series of cases that the targets refer to."""

CaseKind = Literal[
    "none", "shifted", "known", "outsider", "pair", "misshapen", "near_unstable",
    "foreign", "foreign_mechanism", "foreign_outsider",
]  # fmt: skip
KINDS: tuple[CaseKind, ...] = (
    "none", "known", "outsider", "pair", "shifted", "misshapen", "near_unstable",
    "foreign", "foreign_mechanism", "foreign_outsider",
)  # fmt: skip
"""No missing effect; one effect of the library; one out-of-library effect; two of the library; parameters far off; one
mechanism of the library in another form than it declares; nothing missing, near the limit of stability; a foreign body
(`mcstudy_challenge.bodies.foreign_body`) with nothing missing, with a mechanism of the library in roughly its form, and
with a cause outside the library."""

NOTHING_MISSING: tuple[CaseKind, ...] = ("none", "shifted", "near_unstable", "foreign")
"""Kinds without a missing effect, in which every detection is a false alarm."""

OUTSIDE: tuple[CaseKind, ...] = ("outsider", "foreign_outsider")
"""Kinds with a cause outside the library."""

OTHER_FORM: tuple[CaseKind, ...] = ("misshapen", "foreign_mechanism")
"""Kinds with a mechanism of the library in another form."""

Share = Annotated[float, Field(ge=0, le=1)]

Amplitude = Annotated[float, Field(ge=1e-3, le=1e3)]
"""Range of stimulus amplitudes, N m; bodies fall far below the upper limit."""

Density = Annotated[float, Field(ge=1e-9, le=1e3)]
"""Range of the PSD of sensor noise, deg^2/Hz."""

Delta = Annotated[float, Field(ge=0.1, le=1e3)]
"""Range of the delta of an effect."""


Decay = Annotated[float, Field(ge=1e-4, le=10)]
"""Range of the decay of a near-unstable body, 1/s."""


class Challenge(Section):
    """Name, seed and number of cases of the main series."""

    name: Name
    seed: int = Field(ge=0, lt=2**63)
    cases: int = Field(ge=1, le=100_000)
    description: str = ""


class Mix(Section):
    """Share of every kind of case; the shares sum to 1."""

    none: Share = 0.25
    known: Share = 0.45
    outsider: Share = 0.15
    pair: Share = 0.10
    shifted: Share = 0.05
    misshapen: Share = 0.0
    near_unstable: Share = 0.0
    foreign: Share = 0.0
    foreign_mechanism: Share = 0.0
    foreign_outsider: Share = 0.0

    @model_validator(mode="after")
    def _whole(self) -> Mix:
        total = sum(self.of(k) for k in KINDS)
        if abs(total - 1) > 1e-9:
            raise ValueError(f"expected shares that sum to 1, got a sum of {total:g}")
        return self

    def of(self, kind: CaseKind) -> float:
        """Share of one kind."""
        return float(getattr(self, kind))


class Bodies(Section):
    """Truth of every case: nominal parameters times a factor uniform within ``spread`` (``shifted_spread`` at least
    half used for shifted ones), redrawn until every mode decays faster than ``decay`` (1/s). Near-unstable ones vary by
    ``shifted_spread``, and their least damped oscillation decays within ``near_decay`` (1/s)."""

    spread: Share = 0.15
    shifted_spread: Share = 0.30
    decay: float = Field(default=0.2, ge=0, le=10)
    near_decay: tuple[Decay, Decay] = (0.1, 0.5)

    @model_validator(mode="after")
    def _ordered(self) -> Bodies:
        slow, fast = self.near_decay
        if fast <= slow:
            raise ValueError(f"near_decay: expected a lower and a larger upper rate, got {slow:g} and {fast:g}")
        return self


class Stratum(Section):
    """A share of the effects with delta uniform from ``low`` to ``high``."""

    share: Share
    low: Delta
    high: Delta


class Sizes(Section):
    """Sizes of effects, as delta: the root of the noncentrality that remains after refitting the model.

    ``effects``: names of the library to draw from; if empty, all that a linear analysis can detect. ``outsiders``,
    ``forms``, ``foreign``: names of out-of-library effects, of misshapen forms and of mechanisms of foreign bodies; if
    empty, all.
    """

    effects: tuple[str, ...] = ()
    outsiders: tuple[str, ...] = ()
    forms: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    strata: Annotated[tuple[Stratum, ...], Field(min_length=1, max_length=100)] = (
        Stratum(share=0.15, low=3.75, high=4.25),
        Stratum(share=0.25, low=5.5, high=6.5),
        Stratum(share=0.60, low=1.0, high=15.0),
    )

    @model_validator(mode="after")
    def _whole(self) -> Sizes:
        total = sum(s.share for s in self.strata)
        if abs(total - 1) > 1e-9:
            raise ValueError(f"expected strata whose shares sum to 1, got a sum of {total:g}")
        for s in self.strata:
            if s.high < s.low:
                raise ValueError(f"expected low <= high, got {s.low:g} and {s.high:g}")
        return self


class Trials(Section):
    """The recording: one trial per amplitude (unit of the stimulus, peak), each of ``cycles`` periods, of which the
    first one is discarded (transient); lines are used up to ``fmax`` Hz."""

    amplitudes: tuple[Amplitude, ...] = Field(default=(5.0, 5.0), min_length=1, max_length=100)
    cycles: int = Field(default=6, ge=3, le=1000)
    fmax: Positive = 8.0


class Noise(Section):
    """Sensor noise: one-sided PSD of theta1 and theta2 at 0.5 Hz in deg^2/Hz times ``level``, falling as f^-colour
    before a first-order low-pass at ``corner_hz``."""

    psd: tuple[Density, Density] = (4e-4, 7e-5)
    level: float = Field(default=1.0, ge=1e-6, le=1e6)
    colour: float = Field(default=1.0, ge=0, le=3)
    corner_hz: float = Field(default=0.15, ge=1e-3, le=1e2)

    @property
    def sensor(self) -> SensorNoise:
        """The noise described."""
        first, second = (p * self.level for p in self.psd)
        return SensorNoise((first, second), self.corner_hz, exponent=self.colour)


class Answering(Section):
    """Method that answers: the shipped diagnosis with asymptotic statistics ("fast") or bootstrap ("bootstrap"), or
    only its test for a gap ("detect")."""

    method: Literal["fast", "bootstrap", "detect"] = "fast"


class Series(Section):
    """One series of cases with all its settings."""

    cases: int = Field(ge=1, le=100_000)
    mix: Mix = Mix()
    body: Bodies = Bodies()
    sizes: Sizes = Sizes()
    protocol: Trials = Trials()
    noise: Noise = Noise()


SECTIONS = ("mix", "body", "sizes", "protocol", "noise")


class ChallengeFile(Section):
    """A resolved challenge: every setting is explicit. The main series is `MAIN`."""

    challenge: Challenge
    answer: Answering = Answering()
    series: dict[Name, Series] = Field(min_length=1, max_length=200)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of everything that changes a case."""
        plain = self.model_dump(mode="json", exclude={"challenge": {"description"}, "answer": True})
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()

    @property
    def total(self) -> int:
        """Cases of all series."""
        return sum(s.cases for s in self.series.values())
