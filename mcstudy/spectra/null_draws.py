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
    """Null samples (4 N, n) for covariances with ``dof`` (N,) degrees of freedom; known ones if ``pooling`` is None.

    ``angles``: how many were measured; the errors of the others are zero.
    """

    def __init__(self, dof: np.ndarray, pooling: Pooling | None, angles: int = 2) -> None:
        self._angles = angles
        self._dof = np.maximum(dof, 3.0)
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
        """``n`` null samples, (4 N, n), in the order and units of `mcstudy.fitting.penalised.whiten`."""
        N = self._dof.size
        z = self._errors(rng, n)
        if self._pooling is not None:
            l11, l21, l22 = self._factors(rng, n)
            first = z[:, 0] / l11
            z = np.stack([first, (z[:, 1] - l21 * first) / l22], axis=1)
        z *= np.sqrt(2 * (self._dof - 2) / self._dof)[:, None, None]
        z = z.reshape(2 * N, n)
        return np.concatenate([z.real, z.imag])

    def joint(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
        """``n`` unit Gaussian errors (N, 2, n), and roots R (N, 2, 2, n) of estimates of their precision, R^H R.

        The precision is unbiased; with a known covariance R is the identity.
        """
        z = self._errors(rng, n)
        root = np.zeros((len(z), 2, 2, n), dtype=complex)
        if self._pooling is None:
            root[:, [0, 1], [0, 1]] = 1.0
            return z, root
        l11, l21, l22 = self._factors(rng, n)
        root[:, 0, 0], root[:, 1, 1], root[:, 1, 0] = 1 / l11, 1 / l22, -l21 / (l11 * l22)
        return z, root * np.sqrt((self._dof - 2) / self._dof)[:, None, None, None]

    def _errors(self, rng: np.random.Generator, n: int) -> np.ndarray:
        N = self._dof.size
        z = np.empty((N, 2, n), dtype=complex)
        z.real, z.imag = rng.standard_normal((N, 2, n)), rng.standard_normal((N, 2, n))
        z /= np.sqrt(2)
        z[:, self._angles :] = 0.0
        return z

    def _factors(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Elements (N, n) of L = [[l11, 0], [l21, l22]] for random S~ = L L^H."""
        products = self._products(rng, n)
        if self._colour is None:
            s11, s22, re, im = np.einsum("le,pen->pln", self._window, products, optimize=True)
        else:
            s11, s22, re, im = self._continued(self._colour, products, rng)
        l11 = np.sqrt(s11)
        l21 = (re + 1j * im) / l11
        return l11, l21, np.sqrt(np.maximum(s22 - np.abs(l21) ** 2, 1e-12))

    def _products(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """|a|^2, |b|^2 and the parts of b a*, (4, E, n), averaged over the records of two errors a, b at even lines.

        They follow a complex Wishart distribution (Goodman 1963, Ann. Math. Statist. 34, 152-177). It is drawn by its
        Cholesky factor (Bartlett's decomposition), so the cost does not grow with the number of records.
        """
        K, shape = self._records, (self._window.shape[1], n)
        out = np.empty((4, *shape))
        rng.standard_gamma(K, out=out[0])
        rng.standard_normal(out=out[2])
        rng.standard_normal(out=out[3])
        out[2:] *= np.sqrt(0.5)
        np.square(out[2:]).sum(axis=0, out=out[1])
        if K > 1:
            out[1] += rng.standard_gamma(K - 1, shape)
        out[2:] *= np.sqrt(out[0])
        out /= K
        return out

    def _continued(self, colour: Colour, products: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Products (4, E, n) at the lines, (4, L, n), with a slope that is estimated for every sample.

        One angle is simulated, because the flatter of the two determines the slope and they differ by far more than
        their scatter.
        """
        mean = products[0, : colour.used].T
        between = rng.standard_gamma(self._further, mean.shape)
        exponent = colour.exponent(np.stack([mean, between])[:, None])[0]
        level, restored = colour.levelled(exponent).T ** 2, colour.restored(exponent).T ** 2
        return restored * np.asarray(np.einsum("le,pen->pln", self._window, products * level, optimize=True))
