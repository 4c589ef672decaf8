"""Detectability and similarity of effects in a recording: the linear Gaussian space of its lines.

The error of a mean FRF y at N odd lines is complex Gaussian with covariance C (E[e e^H]), so twice V = sum r^H C^-1 r
is chi-squared with 4 N degrees of freedom. The *delta* of an effect is the root of the noncentrality it leaves after
the model's own parameters have been refitted, delta^2 = min over theta of 2 V(noise-free y). It is the mean of the best
possible test statistic for that effect in standard deviations. Its *signature* is the whitened residual it leaves, as a
unit vector. It is computed at a finite size, because some effects (a low-pass on delayed feedback) have a derivative
that the model's parameters absorb entirely, and appear only through their curvature. Derived.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol
from mcstudy.fitting.problem import ml_cost
from mcstudy.fitting.solvers import fit
from mcstudy.recordings.recording import Recording
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf, frf_jacobian, system
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stance.stability import rightmost_root

SIMILAR = 0.90
"""Smallest |cosine| at which an answer that groups two effects is accepted for either of them."""

VISIBLE = 2.0
"""Delta that an effect must reach within its bounds to be drawn, or to be a hypothesis of the oracle bound."""

INVISIBLE = 0.2
"""Delta below which a probe does not determine the direction of an effect."""

GAINS, DELAYS_S = (-2.0, 6.0), (0.001, 0.3)
"""Bounds of a refit: gains as multiples of the nominal value, delays in s. A diagnosis does not know the parameters of
the body, so bounds must not make an effect detectable."""

SPLINES = 12
"""Number of knots of a smooth torque over log frequency, about one and a half per octave."""

REAL = 1e-6
"""Imaginary part (rad/s) below which a root is real."""

DISCARD = 1
"""Number of cycles with transient at the start of a trial."""


def stands(model: Model, theta: np.ndarray, decay: float) -> bool:
    """Whether the loop is stable and its slowest oscillating mode decays faster than ``decay`` (1/s).

    A mode that does not oscillate may decay slowly: an integral term creates such a mode with negligible amplitude.
    """
    root = complex(rightmost_root(model, theta).root)
    return root.real < (0.0 if abs(root.imag) < REAL else -decay)


def free(model: Model) -> Model:
    """The model with bounds so wide that no refit reaches them."""
    return model.with_bounds(
        {
            p.name: DELAYS_S if p.name in model.delays else (GAINS[0] * p.value, GAINS[1] * p.value)
            for p in model.parameters
        }
    )


@dataclass(frozen=True)
class Setting:
    """Lines of a protocol: f (N,) Hz, excited odd harmonics up to ``fmax``; energy (N,): sum of |U|^2 over all
    analysed cycles; share (R,): share of each cycle in it."""

    protocol: Protocol
    harmonic: np.ndarray
    f: np.ndarray
    energy: np.ndarray
    share: np.ndarray

    @classmethod
    def of(cls, protocol: Protocol, fmax: float) -> Setting:
        """Setting of a periodic protocol."""
        period_s = protocol.waveform.period_s
        harmonic = np.arange(1, int(fmax * period_s + 0.5) + 1, 2)
        unit = np.abs(protocol.waveform.coefficients()[harmonic] / protocol.waveform.amplitude) ** 2
        squares = np.repeat(np.square(protocol.amplitudes), protocol.cycles - DISCARD)
        return cls(protocol, harmonic, harmonic / period_s, unit * squares.sum(), squares / squares.sum())

    def covariance(self, model: Model, theta: np.ndarray, noise: SensorNoise) -> np.ndarray:
        """Covariance (N, 2, 2) of the mean FRF of a recording of this model."""
        density = sway_psd(model, theta, noise, self.f)
        return density / (2 * self.protocol.waveform.period_s) / self.energy[:, None, None]


def cycle_responses(recording: Recording, setting: Setting) -> np.ndarray:
    """FRFs (R, N, 2) of every analysed cycle, without leakage of the step between a cycle's ends."""
    period = setting.protocol.waveform.samples
    step = 1.0 - np.exp(-2j * np.pi * setting.harmonic / period)
    out = []
    for trial in recording.trials:
        for start in range(DISCARD * period, trial.samples - period + 1, period):
            u = np.fft.rfft(trial.stimulus[start : start + period])[setting.harmonic]
            increments = np.diff(trial.theta[start - 1 : start + period], axis=0)
            out.append(np.fft.rfft(increments, axis=0)[setting.harmonic] / (step * u)[:, None])
    return np.array(out)


def best_fit(model: Model, starts: np.ndarray, f: np.ndarray, y: np.ndarray, C: np.ndarray) -> tuple[float, np.ndarray]:
    """Noncentrality 2 V that the best fit of ``model`` from ``starts`` (S, P) leaves in noise-free FRFs y (N, 2), and
    the FRFs (N, 2) of that fit."""
    inside = np.clip(np.atleast_2d(starts), model.lower, model.upper)
    fits = fit(ml_cost(model, f, y, C), inside, "lm")
    return 2.0 * float(fits.cost[fits.best]), frf(model, fits.estimate[fits.best], f)


def scatter(cycles: np.ndarray, share: np.ndarray, C: np.ndarray) -> float:
    """Noncentrality of the differences between cycles (R, N, 2), which no time-invariant linear model explains."""
    r = cycles - np.einsum("r,rnj->nj", share, cycles)
    return 2.0 * float(np.einsum("r,rni,nij,rnj->", share, r.conj(), np.linalg.inv(C), r, optimize=True).real)


@dataclass(frozen=True)
class Probe:
    """An effect at a size at which its delta is typical of the benchmark."""

    effect: str
    sizes: Mapping[str, float]


@dataclass(frozen=True)
class Column:
    """One signature: unit vector (4 N,), the probe at which it was computed, and its delta there."""

    probe: Probe
    unit: np.ndarray
    delta: float

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.probe.effect


@dataclass(frozen=True)
class Geometry:
    """The space of one body: base model (its bounds are those of the refits), true parameters (12,), lines, noise.

    ``louder`` (N, 2, 2): covariance of the noise, whitened by that of the base model, for a cause that changes it.
    """

    base: Model
    theta: np.ndarray
    setting: Setting
    noise: SensorNoise
    louder: np.ndarray | None = None

    @cached_property
    def C(self) -> np.ndarray:
        """Covariance of the mean FRF, (N, 2, 2)."""
        C = self.setting.covariance(self.base, self.theta, self.noise)
        if self.louder is None:
            return C
        root = np.linalg.cholesky(C)
        return np.asarray(root @ self.louder @ root.conj().swapaxes(1, 2))

    @cached_property
    def _weight(self) -> np.ndarray:
        return np.linalg.inv(np.linalg.cholesky(self.C))

    def whiten(self, r: np.ndarray) -> np.ndarray:
        """Residuals (N, 2) as real numbers (4 N,) of unit variance."""
        z = np.einsum("nij,nj->ni", self._weight, r) * np.sqrt(2)
        return np.concatenate([z.real.ravel(), z.imag.ravel()])

    def unexplained(self, y: np.ndarray) -> np.ndarray:
        """Whitened residual (4 N,) of noise-free FRFs y (N, 2) after refitting the base model; its norm is delta."""
        done = fit(ml_cost(self.base, self.setting.f, y, self.C), self.theta[None], "lm")
        return self.whiten(y - frf(self.base, done.estimate[0], self.setting.f))

    @cached_property
    def _smooth(self) -> np.ndarray:
        """Orthonormal basis (4 N, 12 + d) of the effects of the model's parameters and of smooth torques of any shape.

        Torques are smooth after the delay of the loop, because missing feedback has the same delay as existing
        feedback.
        """
        model, s = self.base, 2j * np.pi * self.setting.f
        pull = np.linalg.inv(system(model, self.theta, s)[0])
        delays = self.theta[np.isin(model.names, model.delays)]
        late = np.exp(-s * delays.mean())
        columns = [
            self.whiten((unit * spline * late)[:, None] * pull[:, :, row])
            for row in (0, 1)
            for spline in _splines(np.log(self.setting.f), SPLINES)
            for unit in (1.0, 1j)
        ]
        _, J = frf_jacobian(model, self.theta, self.setting.f)
        columns += [self.whiten(J[..., p]) for p in range(J.shape[-1])]
        return np.asarray(np.linalg.qr(np.column_stack([x / np.linalg.norm(x) for x in columns]))[0])

    def smoothed(self, r: np.ndarray) -> np.ndarray:
        """The part of a deviation (N, 2) that the model's parameters and a smooth torque can produce."""
        z = (self._smooth @ (self._smooth.T @ self.whiten(r))).reshape(2, *r.shape)
        return np.asarray(np.einsum("nij,nj->ni", np.linalg.cholesky(self.C), z[0] + 1j * z[1]) / np.sqrt(2))

    def smooth_delta(self, x: np.ndarray) -> float:
        """Delta of the part of a whitened residual (4 N,) of a refit that a smooth torque can produce."""
        return float(np.linalg.norm(self._smooth.T @ x))

    @property
    def smooth_dof(self) -> int:
        """Dimension of the space of smooth torques beyond that of the model's parameters."""
        return int(self._smooth.shape[1]) - self.theta.size

    def response(self, effects: Sequence[str], sizes: Mapping[str, float], decay: float) -> np.ndarray | None:
        """FRFs (N, 2) with linear effects; None when the body is not stable enough, see `stands`."""
        model = library.apply(self.base, *effects)
        own = [sizes.get(s.name, s.parameter.value) for n in effects for s in library.effect(n).sizes]
        theta = np.concatenate([self.theta, own])
        return frf(model, theta, self.setting.f) if stands(model, theta, decay) else None

    def columns(self, probes: Sequence[Probe]) -> list[Column]:
        """Signatures of the probes on this body, each reduced in size until the body is stable with it."""
        out = []
        for probe in probes:
            first = library.effect(probe.effect).size
            for shrink in (1.0, 0.5, 0.25):
                sizes = {**probe.sizes, first.name: probe.sizes[first.name] * shrink}
                y = self.response([probe.effect], sizes, 0.0)
                if y is not None:
                    x = self.unexplained(y)
                    delta = float(np.linalg.norm(x))
                    if delta > INVISIBLE:
                        out.append(Column(Probe(probe.effect, sizes), x / delta, delta))
                    break
        return out


def _splines(x: np.ndarray, n: int) -> np.ndarray:
    """Natural cubic splines through unit values at ``n`` equal steps of x, (n, len(x))."""
    knots = np.linspace(x.min(), x.max(), n)
    return np.asarray(CubicSpline(knots, np.eye(n), bc_type="natural")(x).T)


PROBED = 6.0
"""Delta at which signatures are computed."""


def probes(geometry: Geometry, names: Sequence[str]) -> list[Probe]:
    """Sizes at which linear effects have a delta of `PROBED`, with both signs if both occur in people, at three values
    of each shape parameter. Effects that stay below `VISIBLE` within their bounds are left out."""
    out = []
    for name in names:
        first, *shapes = library.effect(name).sizes
        grids: list[dict[str, float]] = [{}]
        for c in shapes:
            low, high = c.published
            grids = [{**g, c.name: v} for g in grids for v in (low, (low + high) / 2, high)]
        for at in grids:
            for limit in (first.upper, first.lower) if first.signed else (first.upper,):
                size, delta = size_for(geometry, name, at, limit, PROBED)
                if delta > VISIBLE:
                    out.append(Probe(name, {first.name: size, **at}))
    return out


def size_for(
    geometry: Geometry, name: str, shapes: Mapping[str, float], limit: float, wanted: float, decay: float = 0.0
) -> tuple[float, float]:
    """Size between 0 and ``limit`` of an effect of the library with a delta of ``wanted``, and its delta; see
    `searched_size`."""
    first = library.effect(name).size
    return searched_size(
        geometry, lambda size: geometry.response([name], {**shapes, first.name: size}, decay), limit, wanted
    )


def searched_size(
    geometry: Geometry, response: Callable[[float], np.ndarray | None], limit: float, wanted: float
) -> tuple[float, float]:
    """Size between 0 and ``limit`` with a delta of ``wanted``, or the closest one with a stable body, and its delta.

    ``response``: FRFs (N, 2) at a size, None for a body that is not stable. Delta grows with size, but not in
    proportion; the interval that contains it is bisected on a log scale.
    """
    low, high, best = 0.0, abs(limit), (0.0, 0.0)
    size = high / 8
    for _ in range(24):
        y = response(float(np.copysign(size, limit)))
        delta = np.inf if y is None else float(np.linalg.norm(geometry.unexplained(y)))
        if abs(delta - wanted) < abs(best[1] - wanted):
            best = float(np.copysign(size, limit)), delta
        if abs(delta / wanted - 1) < 0.01 or high / max(low, 1e-300) < 1.01:
            break
        if delta < wanted:
            low = size
            if size == high:
                break
        else:
            high = size
        guess = size * wanted / delta if 0 < delta < np.inf else 0.0
        middle = np.sqrt(low * high) if low > 0 else high / 8
        size = float(guess) if low < guess < high else (high if guess >= high else middle)
    return best
