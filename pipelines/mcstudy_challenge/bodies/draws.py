"""Bodies and sizes of effects that are drawn for the cases of a series, and the effects that its recordings show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol
from mcstudy.errors import DesignError
from mcstudy.stance.body import two_segment
from mcstudy_challenge.bodies.geometry import VISIBLE, Geometry, Probe, Setting, free, probes, size_for, stands
from mcstudy_challenge.design import MAIN, ChallengeFile, Series

ATTEMPTS = 200
"""Number of bodies tried for one case before the challenge is refused as impossible."""

NIMBLE = 0.7
"""Factor on the delays of the fastest bodies; with some effects only bodies with short delays are stable."""


def protocol_of(series: Series) -> Protocol:
    """How the recordings of a series are made."""
    return Protocol(amplitudes=series.protocol.amplitudes, cycles=series.protocol.cycles, noise=series.noise.sensor)


@lru_cache(maxsize=64)
def _shared(text: str) -> tuple[Setting, tuple[Probe, ...]]:
    """Properties common to all cases of a series: its lines, and the effects that are detectable in them."""
    series = Series.model_validate_json(text)
    protocol, base = protocol_of(series), two_segment()
    setting = Setting.of(protocol, series.protocol.fmax)
    wanted = [n for n in series.sizes.effects or library.LIBRARY.linear if library.effect(n).kind == "linear"]
    found = probes(Geometry(free(base), base.truth, setting, protocol.noise), wanted)
    nimble = np.where(np.isin(base.names, base.delays), NIMBLE, 1.0) * base.truth
    missing = [n for n in wanted if n not in {p.effect for p in found}]
    found += probes(Geometry(free(base), nimble, setting, protocol.noise), missing)
    return setting, tuple(found)


def shared(series: Series) -> tuple[Setting, tuple[Probe, ...]]:
    """Lines of a series and probes of every effect that is detectable in them."""
    return _shared(series.model_copy(update={"cases": 1}).model_dump_json())


def pool(series: Series) -> list[str]:
    """Effects that the cases of a series may have: those named, or all detectable linear ones."""
    visible = list(dict.fromkeys(p.effect for p in shared(series)[1]))
    named = series.sizes.effects
    for name in named:
        if library.effect(name).kind == "linear" and name not in visible:
            raise DesignError(f"sizes.effects: {name} stays below a delta of {VISIBLE:g} within its bounds")
    return list(named) or visible


def check_visible(file: ChallengeFile) -> None:
    """Raise `DesignError` unless the recordings of every series show as many effects as its cases have."""
    for name, series in file.series.items():
        wanted = 2 if series.mix.pair else 1 if series.mix.known else 0
        section = "" if name == MAIN else f"variant.{name}."
        try:
            found = pool(series) if wanted else []
        except DesignError as error:
            raise DesignError(f"{section}{error}") from None
        if len(found) < wanted:
            raise DesignError(
                f"{section}protocol: expected recordings in which at least {wanted} of the effects can reach a delta "
                f"of {VISIBLE:g}, found {len(found)} (use more cycles, larger amplitudes or less noise)"
            )


@dataclass(frozen=True)
class Truth:
    """A drawn case with linear effects: parameters of the base model (12,) and sizes of the effects."""

    theta: np.ndarray
    effects: tuple[str, ...]
    sizes: dict[str, float]


def draw_body(series: Series, rng: np.random.Generator, shifted: bool, nimble: float = 1.0) -> np.ndarray:
    """Parameters (12,) of a clearly stable body: every mode decays faster than the challenge's ``decay``.

    ``nimble`` multiplies the delays. Raises `DesignError` when none is found.
    """
    base = two_segment()
    lag = np.isin(base.names, base.delays)
    spread = series.body.shifted_spread if shifted else series.body.spread
    for _ in range(ATTEMPTS):
        change = rng.uniform(-spread, spread, lag.size)
        if shifted:
            change = np.where(np.abs(change) < spread / 2, np.copysign(spread, change) - change, change)
        factor = 1 + change
        factor[lag] *= nimble
        theta = np.clip(base.truth * factor, base.lower, base.upper)
        if stands(base, theta, series.body.decay):
            return np.asarray(theta)
    raise DesignError(f"body: no stable body found in {ATTEMPTS} draws with a spread of {spread:g}")


def draw_delta(series: Series, rng: np.random.Generator) -> float:
    """A delta from the strata."""
    share = np.array([s.share for s in series.sizes.strata])
    stratum = series.sizes.strata[int(rng.choice(share.size, p=share / share.sum()))]
    return float(rng.uniform(stratum.low, stratum.high))


def draw_linear(series: Series, rng: np.random.Generator, names: Sequence[str]) -> Truth | None:
    """A body and sizes for which each linear effect alone has a drawn delta; None when no such body is stable.

    The body is drawn again, each time with shorter delays, until each delta is within 10 % and the body is stable with
    all effects together.
    """
    setting, _ = shared(series)
    for attempt in range(12):
        nimble = 1.0 - (1.0 - NIMBLE) * min(1.0, attempt / 6)
        theta = draw_body(series, rng, False, nimble)
        geometry = Geometry(free(two_segment()), theta, setting, series.noise.sensor)
        sizes: dict[str, float] = {}
        for name in names:
            first, *shapes = library.effect(name).sizes
            at = {c.name: c.draw(rng) for c in shapes}
            limit = first.lower if first.signed and rng.random() < 0.5 else first.upper
            wanted = draw_delta(series, rng)
            size, delta = size_for(geometry, name, at, limit, wanted, series.body.decay)
            if abs(delta / wanted - 1) > 0.1:
                break
            sizes |= {first.name: size, **at}
        else:
            if geometry.response(names, sizes, series.body.decay) is not None:
                return Truth(theta, tuple(names), sizes)
    return None
