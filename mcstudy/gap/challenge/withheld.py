"""Causes without a closed form - outsiders, nonlinear and drifting effects - measured by noise-free time simulations.

The delta of an outsider is that of the part of its residual that a smooth torque can make. A nonlinearity also
scatters energy from line to line, and a wandering one from cycle to cycle; nobody who does not know the cause can tell
that from noise, so it does not count. For a nonlinear or drifting effect of the library, which a diagnosis does know,
all of it counts.

The response of a cause is the difference between simulations with and without it, added to the closed form, so that
what the simulator itself leaves (a transient that has not died out) is not taken for a cause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.errors import InputError
from mcstudy.gap import effects as library
from mcstudy.gap.challenge.cases import draw_body, draw_delta, shared
from mcstudy.gap.challenge.design import Series
from mcstudy.gap.challenge.geometry import Geometry, Setting, cycle_responses, free, scatter
from mcstudy.gap.make_recording import Protocol, simulate_recording
from mcstudy.gap.outsiders import OUTSIDERS, simulate_outsider
from mcstudy.gap.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SILENT
from mcstudy.stance.response import frf

Simulate = Callable[[float, Protocol, np.random.Generator], Recording]
"""(size, protocol, rng) -> a recording; size 0 is the body without the cause."""

SETTLED = 3
"""Cycles simulated for a cause that does not depend on time: the last one is taken for all."""

NEAR = 0.15
"""Relative distance from the wanted delta at which the search for a size stops."""

BODIES = 6
"""Bodies tried before a cause is given up for a case."""


@dataclass(frozen=True)
class Measured:
    """A cause at one size: mean FRF (N, 2) it gives, delta by which it is sized, and delta of all it does."""

    size: float
    response: np.ndarray
    delta: float
    total: float


class Withheld:
    """A cause on one body, with its responses by size."""

    def __init__(self, geometry: Geometry, simulate: Simulate, lasting: bool, named: bool) -> None:
        """``lasting``: whether the cause is the same in every cycle. ``named``: whether the library holds it."""
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
        """The cause at a size; `InputError` when the body cannot stand with it."""
        g = self.geometry
        y = self._cycles(size) - self._without + frf(g.base, g.theta, g.setting.f)
        mean = np.einsum("r,rnj->nj", g.setting.share, y)
        between = scatter(y, g.setting.share, g.C)
        left = g.unexplained(mean)
        total = float(np.sqrt(left @ left + between))
        return Measured(size, mean, total if self.named else g.smooth_delta(left), total)

    def at_delta(self, start: float, largest: float, wanted: float) -> Measured | None:
        """The cause near the wanted delta, from at most six simulations; None when it cannot be had."""
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
    """A drawn cause without a closed form: body (12,), geometry, what it does, and how to simulate it with noise."""

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
) -> tuple[np.ndarray, Geometry, Measured, Simulate] | None:
    setting: Setting = shared(series)[0]
    for _ in range(BODIES):
        theta = draw_body(series, rng, False)
        geometry = Geometry(free(two_segment()), theta, setting, series.noise.sensor)
        simulate = make(theta)
        found = Withheld(geometry, simulate, lasting, named).at_delta(size, top, draw_delta(series, rng))
        if found is not None:
            return theta, geometry, found, simulate
    return None


def draw_outsider(series: Series, rng: np.random.Generator, name: str) -> Drawn | None:
    """A body and a size at which an effect outside the library has about a drawn delta; None when none stands."""
    outsider = OUTSIDERS[name]

    def make(theta: np.ndarray) -> Simulate:
        def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
            if size == 0.0:
                return simulate_recording(protocol, theta, stream)
            return simulate_outsider(name, size, protocol, theta, stream)

        return simulate

    low, high = outsider.size
    done = _draw(series, rng, make, outsider.measure is None, False, float(np.sqrt(low * high)), 3 * high)
    if done is None:
        return None
    theta, geometry, found, simulate = done
    return Drawn(theta, geometry, found, {"size": found.size}, lambda p, r: simulate(found.size, p, r))


def draw_nonlinear(series: Series, rng: np.random.Generator, name: str) -> Drawn | None:
    """The same for an effect of the library that is a rule of the time-domain simulator."""
    effect = library.effect(name)
    first = effect.size
    sign = -1.0 if first.signed and rng.random() < 0.5 else 1.0
    companions = {c.name: c.draw(rng) for c in effect.sizes[1:]}

    def make(theta: np.ndarray) -> Simulate:
        def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
            names, sizes = ([name], {first.name: size, **companions}) if size else ([], {})
            return simulate_recording(protocol, theta, stream, effects=names, sizes=sizes)

        return simulate

    start = sign * float(np.sqrt(first.published[0] * first.published[1]))
    done = _draw(series, rng, make, effect.kind == "nonlinear", True, start, max(abs(first.lower), abs(first.upper)))
    if done is None:
        return None
    theta, geometry, found, simulate = done
    sizes = {first.name: found.size, **companions}
    return Drawn(theta, geometry, found, sizes, lambda p, r: simulate(found.size, p, r))
