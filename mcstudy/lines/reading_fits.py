"""Fits of the base model under readings of the labels: the recorded responses are T(f) times those of the body.

Most readings are far from any body, so each is first fitted loosely from a few starts, and fitted again only when
another start could still make it compete. On 61 recordings that were mislabelled in known ways (`sound(1)` and
`sound(4)` of `pipelines.validation.mislabelled_recordings`), the loose fit of the right reading ended at most 15 below
the lowest minimum known, in log evidence; where an angle was given as its integral, at most 438. There the labels
themselves ended more than 10^5 below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.fitting.penalised import ITERATIONS, TOLERANCE, Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.lines.base_fit import drawn_starts, linearised_starts, lowest_minima
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model

FEW = 8
"""Random starts of the first fits."""

LOOSE, SHORT = 1.0, 15
"""Decrease of chi2 at which the first fits have converged, and their most iterations."""

HOPELESS = 500.0
"""A reading whose first fits stay this far below the labels in log evidence is not fitted again."""

COARSE = 0.1
"""Decrease of chi2 at which the fits along a grid have converged that only finds the region of the best value."""

ROUNDS = 8
"""Most refinements of a delay or corner, each by a factor of 4."""

RESTARTS = 3
"""Most repeated searches for a delay or corner, each from the best body for the value that the last one found."""


@dataclass(frozen=True)
class Relabelled(Fitted):
    """A fit under a reading: its responses and derivatives are those of the recorded channels.

    ``mix``: (N, 2, 2), what multiplies the responses of the body, mean over the trials.
    """

    mix: np.ndarray = field(repr=False)

    @property
    def body(self) -> Fitted:
        """The fit of the body alone, to corrected responses."""
        return Fitted(self.model, self.prior, self.theta, self.chi2, self.penalty, self.information)

    def _responses(self, f: np.ndarray) -> np.ndarray:
        """Of the recorded channels."""
        return np.einsum("nij,nj->ni", self.mix, super()._responses(f))

    def _derivative(self, data: Data) -> np.ndarray:
        """Of the recorded channels."""
        return super()._derivative(replace(data, weight=data.weight @ self.mix))


def of_part(fitted: Fitted, block: slice, member: Model) -> Fitted:
    """A fit as seen in one recording of a joint set, whose lines are a ``block`` and whose model is ``member``."""
    if isinstance(fitted, Relabelled):
        return replace(fitted, model=member, mix=fitted.mix[block])
    return replace(fitted, model=member)


@dataclass(frozen=True)
class _Corrected:
    """Responses of the body under readings (leading axes G, or none).

    ``y`` (G, N, 2), ``weight`` (G, N, 2, 2) their whiteners, ``apart`` (G,) the squared difference that is left between
    the trials, ``mix`` (G, N, 2, 2) the mean of T over the trials.
    """

    y: np.ndarray
    weight: np.ndarray
    apart: np.ndarray
    mix: np.ndarray


@dataclass(frozen=True)
class _Trials:
    """The mean responses of every trial: y (K, N, 2), their whiteners (K, N, 2, 2), and the shares (K, N).

    Of a joint set those of every recording, with a share of one at its own lines and none at the others.
    """

    names: tuple[int, ...]
    y: np.ndarray
    weight: np.ndarray
    share: np.ndarray

    @classmethod
    def of(cls, lines: Lines) -> _Trials:
        if len(lines.parts) > 1:
            membership = np.array([np.isin(np.arange(len(lines)), np.r_[block]) for block in lines.blocks], dtype=float)
            weight = membership[..., None, None] * lines.noise.whitener
            return cls(tuple(range(len(membership))), membership[..., None] * lines.y, weight, membership)
        names = tuple(int(k) for k in np.unique(lines.trial))
        parts = [lines.subset(lines.trial == k) for k in names]
        share = np.array([lines.weight[lines.trial == k].sum(axis=0) for k in names])
        return cls(
            names,
            np.array([p.y for p in parts]),
            np.sqrt(share)[..., None, None] * lines.noise.whitener,
            share,
        )

    def corrected(self, T: np.ndarray) -> _Corrected:
        """Responses of the body when trial k recorded T_k times them; ``T``: (..., K, N, 2, 2)."""
        # Two angles, so every product is written out: libraries take ten times as long for matrices this small.
        w = self.weight
        z = [w[..., i, 0] * self.y[..., 0] + w[..., i, 1] * self.y[..., 1] for i in (0, 1)]
        A = [[w[..., i, 0] * T[..., 0, j] + w[..., i, 1] * T[..., 1, j] for j in (0, 1)] for i in (0, 1)]
        precision = [
            [(A[0][i].conj() * A[0][j] + A[1][i].conj() * A[1][j]).sum(axis=-2) for j in (0, 1)] for i in (0, 1)
        ]
        first, second = ((A[0][i].conj() * z[0] + A[1][i].conj() * z[1]).sum(axis=-2) for i in (0, 1))
        # W with W^H W = precision, lower triangular as fits read it
        weight = np.zeros((*first.shape, 2, 2), dtype=complex)
        last = np.sqrt(precision[1][1].real)
        beside = precision[1][0] / last
        weight[..., 1, 1], weight[..., 1, 0] = last, beside
        weight[..., 0, 0] = np.sqrt(precision[0][0].real - beside.real**2 - beside.imag**2)
        y = np.empty((*first.shape, 2), dtype=complex)
        y[..., 0] = (first - precision[0][1] * second / precision[1][1]) / weight[..., 0, 0] ** 2
        y[..., 1] = (second - precision[1][0] * y[..., 0]) / precision[1][1]
        left = [z[i] - A[i][0] * y[..., None, :, 0] - A[i][1] * y[..., None, :, 1] for i in (0, 1)]
        apart = sum((x.real**2 + x.imag**2).sum(axis=(-2, -1)) for x in left)
        mix = np.einsum("kn,...knij->...nij", self.share, T)
        return _Corrected(y, weight, np.asarray(apart), mix)


@dataclass(frozen=True)
class Along:
    """The best reading of a family with one number x: ``evidence`` at the best ``x``, its standard error ``se``."""

    evidence: float
    x: float
    se: float
    fitted: Relabelled
    data: Data

    @property
    def integrated(self) -> float:
        """Log evidence integrated over x with a flat density."""
        return float(self.evidence + np.log(self.se * np.sqrt(2 * np.pi)))


class Search:
    """Fits of the base model under readings of one recording.

    Parameters
    ----------
    lines: the measured lines. base, minima: best fit of the base model and its lowest minima (K, P). seed: of starts.
    """

    def __init__(self, lines: Lines, base: Fitted, minima: np.ndarray, seed: int) -> None:
        self._trials, self.f, self._seed = _Trials.of(lines), lines.f, seed
        self._base, self._minima = base, minima
        self._fitter = Fitter(base.model, base.prior, lines.f)
        self._apart = float(self._trials.corrected(self.same).apart)

    @property
    def trials(self) -> tuple[int, ...]:
        """Indices of the trials, or of the recordings of a joint set."""
        return self._trials.names

    @property
    def same(self) -> np.ndarray:
        """T of correct labels, (K, N, 2, 2)."""
        return np.broadcast_to(np.eye(2, dtype=complex), (len(self.trials), self.f.size, 2, 2))

    def only(self, T: np.ndarray, trial: int | None) -> np.ndarray:
        """T (..., N, 2, 2) of every trial (or recording of a joint set), or of one of them, (..., K, N, 2, 2)."""
        out = np.array(np.broadcast_to(self.same, (*T.shape[:-3], *self.same.shape)))
        where = slice(None) if trial is None else self.trials.index(trial)
        out[..., where, :, :, :] = T[..., None, :, :, :] if trial is None else T
        return out

    def gain(self, T: np.ndarray) -> np.ndarray:
        """Decrease (...) of the squared difference between trials under T (..., K, N, 2, 2)."""
        return np.asarray(self._apart - self._trials.corrected(T).apart)

    def promising(self, T: np.ndarray, fitter: Fitter | None = None) -> np.ndarray:
        """Which of the readings T (G, K, N, 2, 2) may compete with the labels, (G,): loose fits from few starts."""
        fitter, made = fitter or self._fitter, self._trials.corrected(T)
        data = [Data(self.f, y, weight) for y, weight in zip(made.y, made.weight, strict=True)]
        starts = drawn_starts(fitter.model, self._seed, FEW)
        fits = fitter.fits(
            np.array([fitter.packed(d) for d in data]),
            np.tile(starts, (len(data), 1)),
            np.repeat(range(len(data)), len(starts)),
            tolerance=LOOSE,
            max_iterations=SHORT,
        )
        lowest = fits.objective.reshape(len(data), -1).min(axis=1)
        log_likelihood = -0.5 * (lowest + made.apart - self._apart)
        return np.asarray(log_likelihood > -0.5 * (self._base.chi2 + self._base.penalty) - HOPELESS)

    def fit(self, T: np.ndarray, fitter: Fitter | None = None) -> tuple[float, Relabelled, Data]:
        """Log evidence under T (K, N, 2, 2), from few starts; the fit, and the corrected data."""
        fitter, made = fitter or self._fitter, self._trials.corrected(T)
        data = Data(self.f, made.y, made.weight)
        drawn = drawn_starts(fitter.model, self._seed, FEW)
        linear = linearised_starts(fitter.model, data, self._seed, 1)
        return self._as_read(fitter.best(data, np.concatenate([drawn, linear])), data, made.apart, made.mix)

    def thoroughly(self, T: np.ndarray, fitter: Fitter | None = None) -> tuple[float, Relabelled, Data]:
        """The same from all starts of the base fit."""
        made = self._trials.corrected(T)
        data = Data(self.f, made.y, made.weight)
        return self._as_read(lowest_minima(fitter or self._fitter, data, self._seed)[0], data, made.apart, made.mix)

    def _as_read(
        self, best: Fitted, data: Data, apart: float | np.ndarray, mix: np.ndarray
    ) -> tuple[float, Relabelled, Data]:
        fitted = Relabelled(best.model, best.prior, best.theta, best.chi2, best.penalty, best.information, mix)
        return fitted.log_evidence - 0.5 * (float(apart) - self._apart), fitted, data

    def along(self, T: Callable[[np.ndarray], np.ndarray], grid: np.ndarray) -> Along | None:
        """The best x near the best one of a uniform ``grid``, from few starts. ``T``: x (G,) -> (G, K, N, 2, 2).

        None when the best x is at the end of the grid, or no x may compete with the labels.
        """
        starts = np.vstack([self._minima[:1], self._base.prior.mean])
        fits = self._at(T(grid), starts, COARSE)
        evidence = np.array([e for e, _, _ in fits])
        best = int(np.argmax(evidence))
        if best in (0, grid.size - 1):
            return None
        drop = 2 * evidence[best] - evidence[best - 1] - evidence[best + 1]
        if evidence[best] + drop < self._base.log_evidence - HOPELESS:
            return None
        near = self._refined(T, float(grid[best]), float(grid[1] - grid[0]), fits[best][1].theta)
        return near if np.isfinite(near.se) else None

    def thoroughly_along(self, T: Callable[[np.ndarray], np.ndarray], x: float, step: float) -> Along | None:
        """The best x near one that few starts have found; ``step``: how far off it may be.

        A wrong body with another x may be a local minimum, so every best x is fitted from all starts, and refined again
        until that finds nothing better.
        """
        best: Along | None = None
        for _ in range(RESTARTS):
            evidence, fitted, _ = self.thoroughly(T(np.array([x]))[0])
            if best is not None and evidence < best.evidence + LOOSE:
                break
            best = self._refined(T, x, step, fitted.theta)
            x = best.x
        return best if best is not None and np.isfinite(best.se) else None

    def _refined(self, T: Callable[[np.ndarray], np.ndarray], x: float, step: float, theta: np.ndarray) -> Along:
        """The best x within 5 steps of a value whose fit is ``theta`` (P,)."""
        se = np.inf
        for _ in range(ROUNDS):
            step /= 4
            grid = x + step * np.arange(-5, 6)
            fits = self._at(T(grid), theta[None], TOLERANCE)
            evidence = np.array([e for e, _, _ in fits])
            best = int(np.argmax(evidence))
            x, theta = float(grid[best]), fits[best][1].theta
            if best in (0, grid.size - 1):
                se, step = np.inf, 4 * step
                continue
            drop = 2 * evidence[best] - evidence[best - 1] - evidence[best + 1]
            if drop > 0 and (se := float(step / np.sqrt(drop))) > step:
                break
        return Along(float(evidence[best]), x, se, fits[best][1], fits[best][2])

    def _at(self, T: np.ndarray, starts: np.ndarray, tolerance: float) -> list[tuple[float, Relabelled, Data]]:
        """Log evidence, the best fit from ``starts`` (S, P) and the data, for each of T (G, K, N, 2, 2)."""
        made, S = self._trials.corrected(T), len(starts)
        data = [Data(self.f, y, weight) for y, weight in zip(made.y, made.weight, strict=True)]
        fits = self._fitter.fits(
            np.array([self._fitter.packed(d) for d in data]),
            np.tile(starts, (len(data), 1)),
            np.repeat(range(len(data)), S),
            tolerance=tolerance,
            max_iterations=ITERATIONS,
        )
        evidences = []
        for i, problem in enumerate(data):
            best = self._fitter.pick(fits, slice(i * S, (i + 1) * S))
            evidences.append(self._as_read(best, problem, made.apart[i], made.mix[i]))
        return evidences
