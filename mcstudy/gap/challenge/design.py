"""What a challenge is: how many cases of which kind, on which recordings, with which effects, sizes and noise.

`mcstudy.gap.challenge.challenge_file` reads it. Limits of single numbers stand here; they are far from what anybody
records, and keep squares and ratios of the numbers within what floating point holds.
"""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Literal

from pydantic import Field, model_validator

from mcstudy.stance.noise import SensorNoise
from mcstudy.study.design import Name, Positive, Section

MAIN = "main"
"""Name of the series of cases that the targets are about."""

Kind = Literal["none", "shifted", "known", "outsider", "pair"]
KINDS: tuple[Kind, ...] = ("none", "known", "outsider", "pair", "shifted")
"""Nothing missing; one effect of the library; one it does not hold; two of it; parameters far off, nothing missing."""

NOTHING: tuple[Kind, ...] = ("none", "shifted")
"""Kinds in which an alarm is false."""

Share = Annotated[float, Field(ge=0, le=1)]

Amplitude = Annotated[float, Field(ge=1e-3, le=1e3)]
"""Of the stimulus: N m. A body falls long before the upper limit."""

Density = Annotated[float, Field(ge=1e-9, le=1e3)]
"""Of sensor noise, deg^2/Hz."""

Delta = Annotated[float, Field(ge=0.1, le=1e3)]
"""Of an effect."""


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

    @model_validator(mode="after")
    def _whole(self) -> Mix:
        total = sum(self.of(k) for k in KINDS)
        if abs(total - 1) > 1e-9:
            raise ValueError(f"expected shares that sum to 1, got a sum of {total:g}")
        return self

    def of(self, kind: Kind) -> float:
        """Share of one kind."""
        return float(getattr(self, kind))


class Body(Section):
    """Truth of every case: nominal parameters times a factor uniform within ``spread`` (``shifted_spread`` at least
    half used for shifted ones), redrawn until every mode decays faster than ``decay`` (1/s)."""

    spread: Share = 0.15
    shifted_spread: Share = 0.30
    decay: float = Field(default=0.2, ge=0, le=10)


class Stratum(Section):
    """A share of the effects with delta uniform from ``low`` to ``high``."""

    share: Share
    low: Delta
    high: Delta


class Sizes(Section):
    """How large effects are, as delta: the root of the noncentrality that an effect leaves after refitting the model.

    ``effects``: names of the library to draw from; all that a linear analysis can see when empty.
    """

    effects: tuple[str, ...] = ()
    outsiders: tuple[str, ...] = ()
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


class Protocol(Section):
    """The recording: one trial per amplitude (unit of the stimulus, peak), all of ``cycles`` periods, the first one
    lost to the transient; lines are used up to ``fmax`` Hz."""

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
    """Who answers: the shipped diagnosis, asymptotic ("fast"), with its bootstrap ("bootstrap"), or
    only whether there is a gap ("detect")."""

    method: Literal["fast", "bootstrap", "detect"] = "fast"


class Series(Section):
    """One series of cases with everything it needs."""

    cases: int = Field(ge=1, le=100_000)
    mix: Mix = Mix()
    body: Body = Body()
    sizes: Sizes = Sizes()
    protocol: Protocol = Protocol()
    noise: Noise = Noise()


SECTIONS = ("mix", "body", "sizes", "protocol", "noise")


class ChallengeFile(Section):
    """A resolved challenge: nothing is left to a default. The main series is `MAIN`."""

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
