"""Causes without a closed form (out-of-library, nonlinear and drifting effects), from noise-free time simulations.

The delta of an out-of-library effect counts only the part of its residual that a smooth torque can produce. A
nonlinearity also scatters energy between lines, and a drift scatters it between cycles. A method that does not know the
cause cannot distinguish that from noise, so it does not count. For a nonlinear or drifting effect of the library, which
a diagnosis knows, the whole residual counts.

The response of a cause is the difference between simulations with and without it, added to the closed form. So errors
of the simulator itself (a remaining transient) do not count as part of the cause.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mcstudy.challenge.cases import NIMBLE, draw_body, draw_delta, shared
from mcstudy.challenge.design import Series
from mcstudy.challenge.geometry import Geometry, Setting, cycle_responses, free, scatter
from mcstudy.challenge.out_of_library import OUT_OF_LIBRARY, simulate_out_of_library
from mcstudy.effect_library import library
from mcstudy.effect_library.simulate import Protocol, simulate_recording
from mcstudy.errors import InputError
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SILENT
from mcstudy.stance.response import frf

Simulate = Callable[[float, Protocol, np.random.Generator], Recording]
"""(size, protocol, rng) -> a recording; size 0 is the body without the cause."""

SETTLED = 3
"""Number of cycles simulated for a cause that does not depend on time; the last one represents all."""

NEAR = 0.15
"""Relative tolerance of delta in the search for a size."""

BODIES = 6
"""Number of bodies tried before a cause is given up for a case."""


@dataclass(frozen=True)
class Measured:
    """A cause at one size: its mean FRF (N, 2), the delta that defines its size, and that of its whole residual."""

    size: float
    response: np.ndarray
    delta: float
    total: float


class Withheld:
    """A cause on one body, with its responses by size."""

    def __init__(self, geometry: Geometry, simulate: Simulate, lasting: bool, named: bool) -> None:
        """``lasting``: whether the cause is the same in every cycle. ``named``: whether it is in the library."""
        self.geometry, self._simulate, self.lasting, self.named = geometry, simulate, lasting, named
        own = geometry.setting.protocol
        self._protocol = replace(own, noise=SILENT, cycles=SETTLED if lasting else own.cycles)
        if len(set(own.amplitudes)) == 1:
            self._protocol = replace(self._protocol, amplitudes=own.amplitudes[:1])
        self._without = self._cycles(0.0)

    def _cycles(self, size: float) -> np.ndarray:
        """Noise-free FRFs of all analysed cycles, (R, N, 2)."""
        setting = replace(self.geometry.setting, protocol=self._protocol)
        recording = self._simulate(size, self._protocol, np.random.default_rng(0))
        one = cycle_responses(recording, setting)
        one = one.reshape(len(self._protocol.amplitudes), -1, *one.shape[1:])
        if self.lasting:
            one = np.repeat(one[:, -1:], self.geometry.setting.protocol.cycles - 1, axis=1)
        repeats = len(self.geometry.setting.protocol.amplitudes) // len(self._protocol.amplitudes)
        return np.concatenate([one] * repeats).reshape(-1, *one.shape[2:])

    def measure(self, size: float) -> Measured:
        """The cause at a size; `InputError` when the body is unstable with it."""
        g = self.geometry
        y = self._cycles(size) - self._without + frf(g.base, g.theta, g.setting.f)
        mean = np.einsum("r,rnj->nj", g.setting.share, y)
        between = scatter(y, g.setting.share, g.C)
        left = g.unexplained(mean)
        total = float(np.sqrt(left @ left + between))
        return Measured(size, mean, total if self.named else g.smooth_delta(left), total)

    def at_delta(self, start: float, largest: float, wanted: float) -> Measured | None:
        """The cause near the required delta, from at most six simulations; None if it cannot be reached."""
        size, best = start, None
        for _ in range(6):
            try:
                now = self.measure(size)
            except InputError:
                size /= 3
                continue
            if best is None or abs(np.log(now.delta / wanted)) < abs(np.log(best.delta / wanted)):
                best = now
            if abs(now.delta / wanted - 1) < NEAR or (now.delta < wanted and size == largest):
                break
            size = float(np.clip(size * np.clip(wanted / max(now.delta, 1e-9), 0.02, 10.0), -largest, largest))
        return best if best is not None and best.delta > 0.5 else None


@dataclass(frozen=True)
class Drawn:
    """A drawn cause without a closed form: body (12,), geometry, response, and a function to simulate it with noise."""

    theta: np.ndarray
    geometry: Geometry
    measured: Measured
    sizes: dict[str, float]
    simulate: Callable[[Protocol, np.random.Generator], Recording]


def _draw(
    series: Series,
    rng: np.random.Generator,
    make: Callable[[np.ndarray], Simulate],
    lasting: bool,
    named: bool,
    size: float,
    top: float,
    nimble: bool = False,
) -> tuple[np.ndarray, Geometry, Measured, Simulate] | None:
    """``nimble``: whether every further body has shorter delays."""
    setting: Setting = shared(series)[0]
    for attempt in range(BODIES):
        theta = draw_body(series, rng, False, 1.0 - (1.0 - NIMBLE) * attempt / BODIES if nimble else 1.0)
        geometry = Geometry(free(two_segment()), theta, setting, series.noise.sensor)
        simulate = make(theta)
        wanted = draw_delta(series, rng)
        found = Withheld(geometry, simulate, lasting, named).at_delta(size, top, wanted)
        if found is not None and (found.delta > wanted / 2 or not nimble):
            return theta, geometry, found, simulate
    return None


def draw_out_of_library(series: Series, rng: np.random.Generator, name: str) -> Drawn | None:
    """A body and a size for which an out-of-library effect has about a drawn delta; None if no body is stable."""
    start, top = _usual(name)
    lasting = OUT_OF_LIBRARY[name].measure is None
    done = _draw(series, rng, partial(_outsider, name), lasting, False, start, top)
    if done is None:
        return None
    theta, geometry, found, simulate = done
    return Drawn(theta, geometry, found, {"size": found.size}, lambda p, r: simulate(found.size, p, r))


def _outsider(name: str, theta: np.ndarray) -> Simulate:
    def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
        if size == 0.0:
            return simulate_recording(protocol, theta, stream)
        return simulate_out_of_library(name, size, protocol, theta, stream)

    return simulate


def _usual(name: str) -> tuple[float, float]:
    """First and largest size of an out-of-library effect."""
    low, high = OUT_OF_LIBRARY[name].size
    return float(np.sqrt(low * high)), 3 * high


def out_of_library_on(geometry: Geometry, name: str, wanted: float) -> Measured | None:
    """An out-of-library effect on one body at about a delta of ``wanted``; None if the body is not stable with it."""
    lasting = OUT_OF_LIBRARY[name].measure is None
    return Withheld(geometry, _outsider(name, geometry.theta), lasting, False).at_delta(*_usual(name), wanted)


def draw_nonlinear(series: Series, rng: np.random.Generator, name: str) -> Drawn | None:
    """The same for an effect of the library that is a rule of the time-domain simulator."""
    effect = library.effect(name)
    first = effect.size
    sign = -1.0 if first.signed and rng.random() < 0.5 else 1.0
    shapes = {c.name: c.draw(rng) for c in effect.sizes[1:]}

    def make(theta: np.ndarray) -> Simulate:
        def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
            names, sizes = ([name], {first.name: size, **shapes}) if size else ([], {})
            return simulate_recording(protocol, theta, stream, effects=names, sizes=sizes)

        return simulate

    start = sign * float(np.sqrt(first.published[0] * first.published[1]))
    top = max(abs(first.lower), abs(first.upper))
    return draw_rule(series, rng, make, effect.kind == "nonlinear", start, top, first.name, shapes)


def draw_rule(
    series: Series,
    rng: np.random.Generator,
    make: Callable[[np.ndarray], Simulate],
    lasting: bool,
    start: float,
    top: float,
    name: str,
    shapes: Mapping[str, float],
    named: bool = True,
    nimble: bool = False,
) -> Drawn | None:
    """A body and a size, from ``start`` up to ``top``, for which what ``make`` simulates has about a drawn delta.

    ``lasting``: whether it is the same in every cycle. ``name``: of the size; ``shapes``: further values for the key.
    ``named``: whether it is in the library. ``nimble``: whether another body, with shorter delays, is drawn until at
    least half of that delta is reached.
    """
    done = _draw(series, rng, make, lasting, named, start, top, nimble)
    if done is None:
        return None
    theta, geometry, found, simulate = done
    sizes = {name: found.size, **shapes}
    return Drawn(theta, geometry, found, sizes, lambda p, r: simulate(found.size, p, r))
