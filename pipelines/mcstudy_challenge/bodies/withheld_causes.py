"""Causes without a closed form (out-of-library, nonlinear and drifting effects), from noise-free time simulations.

The delta of an out-of-library effect counts only the part of its residual that a smooth torque can produce. A
nonlinearity also scatters energy between lines, and a drift scatters it between cycles. A method that does not know the
cause cannot distinguish that from noise, so it does not count; what differs between cycles makes the noise larger, as
it does for a method that measures noise from these differences. For a nonlinear or drifting effect of the library,
which a diagnosis knows, the whole residual counts.

The response of a cause is the difference between simulations with and without it, added to the closed form. So errors
of the simulator itself (a remaining transient) do not count as part of the cause.

A cause that depends on the sway in more than proportion, such as a threshold, meets the noise of the senses as well as
the response to the stimulus, and noise that crosses a threshold all the time smooths it away. It is simulated with
noise, with and without the cause, and once more with the same noise of opposite sign; the mean of both is free of what
is proportional to the noise. Only the part of it that a smooth torque can produce counts. What noise leaves in it by
chance is known from the differences between cycles and subtracted from the square of delta. Such a cause also changes
the noise of the sway, so delta is in units of the noise with the cause, and sizes with which the body oscillates by
itself are refused. Causes that are linear, even if they change with
time, have the same mean response with and without noise; they are simulated without, except held commands, which fold
noise of high frequencies into the band.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import InputError
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SILENT, SensorNoise
from mcstudy.stance.response import frf
from mcstudy_challenge.bodies.draws import NIMBLE, draw_body, draw_delta, shared
from mcstudy_challenge.bodies.geometry import Geometry, Setting, cycle_responses, free, scatter
from mcstudy_challenge.bodies.out_of_library import OUT_OF_LIBRARY, simulate_out_of_library
from mcstudy_challenge.design import Series

Simulate = Callable[[float, Protocol, np.random.Generator], Recording]
"""(size, protocol, rng) -> a recording; size 0 is the body without the cause."""

SETTLED = 3
"""Number of cycles simulated for a cause that does not depend on time; the last one represents all."""

NOISY = 6
"""Number of cycles simulated for a cause whose response depends on noise."""

NEAR = 0.15
"""Relative tolerance of delta in the search for a size."""

NEIGHBOURS = 3
"""Number of neighbouring lines over which the covariance of noise is averaged."""

LOUDEST = 30.0
"""Largest power of the noise with a cause, relative to that without; a body with more oscillates by itself."""

BODIES = 6
"""Number of bodies tried before a cause is given up for a case."""


@dataclass(frozen=True)
class Measured:
    """A cause at one size: its mean FRF (N, 2), the delta that defines its size, and that of its whole residual.

    ``louder`` (N, 2, 2): covariance of the noise with it, whitened by that without, where it was measured.
    """

    size: float
    response: np.ndarray
    delta: float
    total: float
    louder: np.ndarray | None = None


class Opposite(SensorNoise):
    """The same noise with the opposite sign."""

    def coefficients(self, rng: np.random.Generator, n_samples: int, rate_hz: float) -> np.ndarray:
        """Random Fourier coefficients of a record, rad, (n_samples // 2 + 1, 2) complex."""
        return -super().coefficients(rng, n_samples, rate_hz)


class Withheld:
    """A cause on one body, with its responses by size."""

    def __init__(self, geometry: Geometry, simulate: Simulate, lasting: bool, named: bool, noisy: bool = False) -> None:
        """``lasting``: whether the cause is the same in every cycle. ``named``: whether it is in the library.
        ``noisy``: whether its mean response depends on noise; only for lasting causes."""
        self.geometry, self._simulate, self.lasting = geometry, simulate, lasting
        self.named, self.noisy = named, noisy
        own = geometry.setting.protocol
        cycles = NOISY if noisy else SETTLED if lasting else own.cycles
        silent = replace(own, noise=SILENT, cycles=cycles)
        if len(set(own.amplitudes)) == 1:
            silent = replace(silent, amplitudes=own.amplitudes[:1])
        opposite = Opposite(**{f.name: getattr(own.noise, f.name) for f in fields(own.noise)})
        self._protocols = [replace(silent, noise=n) for n in (own.noise, opposite)] if noisy else [silent]
        self._repeats = slice(None) if noisy or not lasting else slice(-1, None)
        self._without = self._signs(0.0)

    def _signs(self, size: float) -> np.ndarray:
        """FRFs (S, A, r, N, 2) of r cycles at every amplitude: without noise, or with both signs of it."""
        signs = []
        for protocol in self._protocols:
            setting = replace(self.geometry.setting, protocol=protocol)
            one = cycle_responses(self._simulate(size, protocol, np.random.default_rng(0)), setting)
            signs.append(one.reshape(len(protocol.amplitudes), -1, *one.shape[1:])[:, self._repeats])
        return np.array(signs)

    def _in_cycles(self, trials: np.ndarray) -> np.ndarray:
        """Responses by amplitude (A, r, N, 2) for all analysed cycles of the recording, (R, N, 2)."""
        own = self.geometry.setting.protocol
        if self.lasting:
            trials = np.repeat(trials, own.cycles - 1, axis=1)
        return np.concatenate([trials] * (len(own.amplitudes) // len(trials))).reshape(-1, *trials.shape[2:])

    def measure(self, size: float) -> Measured:
        """The cause at a size; `InputError` when the body is unstable with it."""
        g, signs = self.geometry, self._signs(size)
        if self.noisy:
            g = replace(g, louder=self._louder(signs))
        trials = (signs - self._without).mean(axis=0)
        whole = smooth = 0.0
        if self.noisy:
            level = trials.mean(axis=1, keepdims=True)
            whole, smooth = self._chance(g, trials - level)
            trials = np.array([[g.smoothed(one[0])] for one in level])
        y = self._in_cycles(trials) + frf(g.base, g.theta, g.setting.f)
        if not (self.named or self.noisy or self.lasting):
            g = replace(g, louder=self._uneven(y))
        mean = np.einsum("r,rnj->nj", g.setting.share, y)
        between = scatter(y, g.setting.share, g.C)
        left = g.unexplained(mean)
        total = float(np.sqrt(max(left @ left + between - whole, 0.0)))
        delta = total if self.named else g.smooth_delta(left)
        if self.noisy and not self.named:
            delta = float(np.sqrt(max(delta**2 - smooth, 0.0)))
        return Measured(size, mean, delta, total, g.louder)

    def _weights(self, amplitudes: int) -> np.ndarray:
        """Share of each simulated amplitude in the energy of the recording, (A,)."""
        share = self.geometry.setting.share
        return np.asarray(share.reshape(-1, amplitudes, share.size // amplitudes).sum(axis=(0, 2)))

    def _louder(self, signs: np.ndarray) -> np.ndarray:
        """Covariance of the noise (N, 2, 2), whitened by that without the cause, from differences between cycles.

        Raises `InputError` where the cause makes it more than `LOUDEST` times as large.
        """
        with_it, without = self._noise(signs), self._noise(self._without)
        unit = np.linalg.inv(np.linalg.cholesky(without))
        return _moderate(unit @ with_it @ unit.conj().swapaxes(1, 2))

    def _uneven(self, y: np.ndarray) -> np.ndarray:
        """Covariance of the noise (N, 2, 2), whitened by that without the cause, of who takes the differences between
        its cycles (R, N, 2) for noise. Raises `InputError` as `_louder`."""
        share = self.geometry.setting.share
        apart = y - np.einsum("r,rnj->nj", share, y)
        z = np.array([self.geometry.whiten(c).reshape(2, -1, 2) for c in apart]) / np.sqrt(2)
        z = z[:, 0] + 1j * z[:, 1]
        lines = np.einsum("r,rni,rnj->nij", share, z, z.conj()) / (len(share) - 1)
        return _moderate(np.eye(2) + _wide(lines))

    def _noise(self, signs: np.ndarray) -> np.ndarray:
        """Covariance (N, 2, 2) of the whitened differences between cycles, averaged over neighbouring lines."""
        apart = signs - signs.mean(axis=2, keepdims=True)
        z = np.array([self.geometry.whiten(c).reshape(2, -1, 2) for c in apart.reshape(-1, *apart.shape[3:])])
        z = (z[:, 0] + 1j * z[:, 1]).reshape(*apart.shape)
        lines = np.einsum("a,sarni,sarnj->nij", self._weights(apart.shape[1]), z, z.conj(), optimize=True)
        return _wide(lines)

    def _chance(self, g: Geometry, apart: np.ndarray) -> tuple[float, float]:
        """Noncentrality that differences between cycles ``apart`` (A, r, N, 2) leave by chance in the responses to all
        amplitudes, and in their mean; both in the space of smooth torques."""
        amplitudes, r = apart.shape[:2]
        whole = smooth = 0.0
        for weight, cycles in zip(self._weights(amplitudes), apart, strict=True):
            variance = sum(g.smooth_delta(g.whiten(c)) ** 2 for c in cycles) / (r * (r - 1))
            whole += weight * variance
            smooth += weight**2 * variance
        return whole, smooth

    def at_delta(self, start: float, largest: float, wanted: float, smallest: float = 0.0) -> Measured | None:
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
            next_size = float(np.clip(size * np.clip(wanted / max(now.delta, 1e-9), 0.02, 10.0), -largest, largest))
            size = float(np.copysign(max(abs(next_size), smallest), size))
        return best if best is not None and best.delta > 0.5 else None


def _moderate(louder: np.ndarray) -> np.ndarray:
    """``louder`` (N, 2, 2) itself; raises `InputError` where it is on average more than `LOUDEST`."""
    if np.trace(louder, axis1=1, axis2=2).real.max() / 2 > LOUDEST:
        raise InputError(f"the cause makes noise more than {LOUDEST:g} times as large")
    return np.asarray(louder)


def _wide(lines: np.ndarray) -> np.ndarray:
    """Covariances (N, 2, 2) averaged over `NEIGHBOURS` neighbouring lines."""
    wide = np.pad(lines, ((NEIGHBOURS // 2, NEIGHBOURS // 2), (0, 0), (0, 0)), mode="reflect")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(wide, NEIGHBOURS, axis=0).mean(axis=-1))


@dataclass(frozen=True)
class Drawn:
    """A drawn cause without a closed form: body (12,), geometry, response, and a function to simulate it with noise."""

    theta: np.ndarray
    geometry: Geometry
    measured: Measured
    sizes: dict[str, float]
    simulate: Callable[[Protocol, np.random.Generator], Recording]


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A cause without a closed form, of sizes from ``start`` up to ``top``.

    ``make``: what simulates it on a body (12,). ``lasting``: whether it is the same in every cycle. ``named``: whether
    it is in the library. ``noisy``: whether delta is measured with noise. ``nimble``: whether another body, with
    shorter delays, is drawn until at least half of the drawn delta is reached. ``smallest``: least magnitude of the
    size that is tried.
    """

    make: Callable[[np.ndarray], Simulate]
    start: float
    top: float
    lasting: bool
    named: bool = True
    noisy: bool = False
    nimble: bool = False
    smallest: float = 0.0

    def at_delta(self, geometry: Geometry, wanted: float) -> Measured | None:
        """The cause on one body at about a delta; None if the body is not stable with it."""
        withheld = Withheld(geometry, self.make(geometry.theta), self.lasting, self.named, self.noisy)
        return withheld.at_delta(self.start, self.top, wanted, self.smallest)


def draw_cause(
    series: Series, rng: np.random.Generator, cause: Cause, name: str, shapes: Mapping[str, float] | None = None
) -> Drawn | None:
    """A body and a size for which a cause has about a drawn delta; None if no body is stable.

    ``name``: of the size; ``shapes``: further values for the key.
    """
    setting: Setting = shared(series)[0]
    for attempt in range(BODIES):
        theta = draw_body(series, rng, False, 1.0 - (1.0 - NIMBLE) * attempt / BODIES if cause.nimble else 1.0)
        geometry = Geometry(free(two_segment()), theta, setting, series.noise.sensor)
        wanted = draw_delta(series, rng)
        try:
            measured = cause.at_delta(geometry, wanted)
        except InputError:  # it falls with noise
            continue
        if measured is not None and (measured.delta > wanted / 2 or not cause.nimble):
            geometry = geometry if measured.louder is None else replace(geometry, louder=measured.louder)
            simulate = partial(cause.make(theta), measured.size)
            return Drawn(theta, geometry, measured, {name: measured.size, **(shapes or {})}, simulate)
    return None


def draw_out_of_library(series: Series, rng: np.random.Generator, name: str) -> Drawn | None:
    """A body and a size for which an out-of-library effect has about a drawn delta; None if no body is stable."""
    return draw_cause(series, rng, _outsider(name), "size")


def out_of_library_on(geometry: Geometry, name: str, wanted: float) -> Measured | None:
    """An out-of-library effect on one body at about a delta of ``wanted``; None if the body is not stable with it."""
    return _outsider(name).at_delta(geometry, wanted)


def _outsider(name: str) -> Cause:
    effect = OUT_OF_LIBRARY[name]
    low, high = effect.size

    def make(theta: np.ndarray) -> Simulate:
        def simulate(size: float, protocol: Protocol, stream: np.random.Generator) -> Recording:
            if size == 0.0:
                return simulate_recording(protocol, theta, stream)
            return simulate_out_of_library(name, size, protocol, theta, stream)

        return simulate

    start = float(np.sqrt(low * high))
    lasting = effect.measure is None
    return Cause(make=make, start=start, top=3 * high, lasting=lasting, named=False, noisy=effect.bends)


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

    low, high = first.published
    start = sign * float(np.sqrt(low * high))
    # A threshold far below the noise is no threshold: sizes are those that are published, or half of the least.
    cause = Cause(make=make, start=start, top=high, lasting=True, noisy=True, smallest=low / 2)
    if effect.kind != "nonlinear":
        cause = Cause(make=make, start=start, top=max(abs(first.lower), abs(first.upper)), lasting=False)
    return draw_cause(series, rng, cause, first.name, shapes)
