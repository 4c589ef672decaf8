"""Null samples: random whitened errors, Gaussian errors divided by a covariance that is itself an estimate.

Given the estimate S of the covariance of a line, the error whitened with S is L^-1 z. Here z is unit Gaussian and
L L^H = S~ is an estimate of the identity from equally few lines. The estimates at neighbouring lines use mostly the
same lines, so S~ is simulated with the same windows. Every null distribution thus includes the finite degrees of
freedom, line by line and jointly; a chi-squared distribution would reject far too often. Derived.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mcstudy.spectra.colour import Colour
from mcstudy.spectra.window import parabolic


@dataclass(frozen=True, eq=False)
class Pooling:
    """Which data the covariance estimates at N lines are averages of.

    Attributes
    ----------
    at, half_width: (N,) position of each line among the even lines, and half-width of the averaging window.
    records: number of independent records averaged; None: the number that the degrees of freedom imply.
    colour_records: number of further records from which the colour of the noise is estimated; None without this step.
    """

    at: np.ndarray
    half_width: np.ndarray
    records: int | None = None
    colour_records: int | None = None

    def at_lines(self, keep: np.ndarray) -> Pooling:
        """At some of the lines."""
        return replace(self, at=self.at[keep], half_width=self.half_width[keep])


def pooled(dof: np.ndarray, trials: int) -> Pooling:
    """Pooling for estimates with ``dof`` (N,) from neighbouring lines of ``trials``, when nothing else is known."""
    at = 2.0 * np.arange(dof.size) + 1.0
    return Pooling(at, np.maximum(1.2 * np.maximum(dof, 3.0) / trials, 2.1), records=trials)


class NullDraws:
    """Null samples (2 N Y, n) for covariances with ``dof`` (N,) degrees of freedom; known ones if ``pooling`` is None.

    ``outputs``: Y.
    """

    def __init__(self, dof: np.ndarray, pooling: Pooling | None, outputs: int) -> None:
        self._outputs = outputs
        self._dof = np.maximum(dof, outputs + 1.0)
        self._pooling = pooling
        self._colour = None
        if pooling is None:
            return
        at, width = pooling.at, pooling.half_width
        top = int(1.1 * at[-1] + min(width[-1], 60.0))
        even = np.arange(2, max(top, 10) + 1, 2)
        self._window = parabolic(at, even, width)
        window_power = 1.0 / (self._window**2).sum(axis=1)
        self._records = pooling.records or max(1, round(float(np.median(self._dof / window_power))))
        if pooling.colour_records is not None:
            self._further = pooling.colour_records
            self._colour = Colour(even, at, (self._records, self._further))

    def __call__(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """``n`` null samples, (2 N Y, n), in the order and units of `mcstudy.fitting.penalised.whiten`."""
        z, outputs = self._errors(rng, n), self._outputs
        if self._pooling is not None:
            L = self._factors(rng, n)
            for i in range(outputs):
                for j in range(i):
                    z[:, i] -= L[i, j] * z[:, j]
                z[:, i] /= L[i, i]
        z *= np.sqrt(2 * (self._dof - outputs) / self._dof)[:, None, None]
        z = z.reshape(-1, n)
        return np.concatenate([z.real, z.imag])

    def joint(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
        """``n`` unit Gaussian errors (N, Y, n), and roots R (N, Y, Y, n) of estimates of their precision, R^H R.

        The precision is unbiased; with a known covariance R is the identity.
        """
        z, outputs = self._errors(rng, n), self._outputs
        root = np.zeros((len(z), outputs, outputs, n), dtype=complex)
        if self._pooling is None:
            root[:, range(outputs), range(outputs)] = 1.0
            return z, root
        L = self._factors(rng, n)
        for i in range(outputs):  # R = L^-1, by columns
            root[:, i, i] = 1 / L[i, i]
            for j in range(i):
                root[:, i, j] = -L[i, j] / (L[j, j] * L[i, i])
                for k in range(j + 1, i):
                    root[:, i, j] -= L[i, k] * root[:, k, j] / L[i, i]
        return z, root * np.sqrt((self._dof - outputs) / self._dof)[:, None, None, None]

    def _errors(self, rng: np.random.Generator, n: int) -> np.ndarray:
        shape = self._dof.size, self._outputs, n
        z = np.empty(shape, dtype=complex)
        z.real, z.imag = rng.standard_normal(shape), rng.standard_normal(shape)
        z /= np.sqrt(2)
        return z

    def _factors(self, rng: np.random.Generator, n: int) -> dict[tuple[int, int], np.ndarray]:
        """Elements (N, n) of the lower triangular L for random S~ = L L^H, by row and column."""
        products = self._products(rng, n)
        if self._colour is None:
            averaged = np.einsum("le,pen->pln", self._window, products, optimize=True)
        else:
            averaged = self._continued(self._colour, products, rng)
        L: dict[tuple[int, int], np.ndarray] = {}
        parts = iter(averaged[self._outputs :])
        for i in range(self._outputs):
            rest = averaged[i]
            for j in range(i):
                element = next(parts) + 1j * next(parts)
                for k in range(j):
                    element = element - L[i, k] * L[j, k].conj()
                L[i, j] = element / L[j, j]
                rest = rest - np.abs(L[i, j]) ** 2
            L[i, i] = np.sqrt(np.maximum(rest, 1e-12) if i else rest)
        return L

    def _products(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Products of the errors of Y outputs at even lines, (Y^2, E, n), averaged over records.

        The squares of all outputs come first, then the parts of the products of every output with those before it.
        They follow a complex Wishart distribution (Goodman 1963, Ann. Math. Statist. 34, 152-177). It is drawn by its
        Cholesky factor (Bartlett's decomposition), so the cost does not grow with the number of records.
        """
        K, Y, shape = self._records, self._outputs, (self._window.shape[1], n)
        out = np.empty((Y * Y, *shape))
        drawn: dict[tuple[int, int], np.ndarray] = {}  # rows of the factor, below its diagonal
        roots, first = [], Y
        for i in range(Y):
            parts = out[first : first + 2 * i]
            for part in parts:
                rng.standard_normal(out=part)
            parts *= np.sqrt(0.5)
            square = rng.standard_gamma(K - i, shape) if i < K else np.zeros(shape)
            for j in range(i):
                drawn[i, j] = parts[2 * j : 2 * j + 2].copy()
            out[i] = (np.square(parts).sum(axis=0) + square) if i else square
            roots.append(np.sqrt(square))
            for j in range(i):
                re, im = drawn[i, j] * roots[j]
                for k in range(j):
                    (a, b), (c, d) = drawn[i, k], drawn[j, k]
                    re, im = re + a * c + b * d, im + b * c - a * d
                parts[2 * j], parts[2 * j + 1] = re, im
            first += 2 * i
        out /= K
        return out

    def _continued(self, colour: Colour, products: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Products (Y^2, E, n) at the lines, (Y^2, L, n), with a slope that is estimated for every sample.

        One output is simulated, because the flattest of them determines the slope and they differ by far more than
        their scatter.
        """
        mean = products[0, : colour.used].T
        between = rng.standard_gamma(self._further, mean.shape)
        exponent = colour.exponent(np.stack([mean, between])[:, None])[0]
        level, restored = colour.levelled(exponent).T ** 2, colour.restored(exponent).T ** 2
        return restored * np.asarray(np.einsum("le,pen->pln", self._window, products * level, optimize=True))
