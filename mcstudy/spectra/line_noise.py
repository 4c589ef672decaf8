"""The noise of measured lines: covariance and degrees of freedom of its estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.short_repr import Summary
from mcstudy.spectra.null_draws import NullDraws, Pooling


@dataclass(frozen=True, eq=False, repr=False)
class LineNoise(Summary):
    """Covariance of the errors of FRFs at N lines, and its uncertainty.

    Attributes
    ----------
    C: (N, Y, Y) complex Hermitian, unbiased estimate of E[e e^H] of Y outputs.
    dof: (N,) complex degrees of freedom of ``C`` (a complex Wishart matrix of that many outer products).
    pooling: how the estimates at neighbouring lines share data; None for a known covariance.
    parts: the noises of independent recordings whose lines follow one another in ``C``, each with a pooling of its
        own; empty for one recording.
    """

    C: np.ndarray
    dof: np.ndarray
    pooling: Pooling | None = None
    parts: tuple[LineNoise, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence[LineNoise]) -> LineNoise:
        """The noise of independent recordings, line after line."""
        return cls(np.concatenate([p.C for p in parts]), np.concatenate([p.dof for p in parts]), parts=tuple(parts))

    @property
    def known(self) -> bool:
        """Whether the covariance is not an estimate."""
        return all(p.known for p in self.parts) if self.parts else self.pooling is None

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        known = "known" if self.known else f"{self.dof.min():.3g} to {self.dof.max():.3g} degrees of freedom"
        return [("lines", str(self.dof.size)), ("covariance", known)]

    @property
    def variance(self) -> np.ndarray:
        """E|e|^2 of each output, (N, Y)."""
        return np.asarray(np.einsum("nii->ni", self.C).real)

    @property
    def whitener(self) -> np.ndarray:
        """W (N, Y, Y), lower triangular: W^H W / 2 is the unbiased estimate of the precision.

        The inverse of an estimate with nu degrees of freedom is too large on average by nu / (nu - Y) (complex
        Wishart, Y channels).
        """
        outputs = self.C.shape[-1]
        nu = np.maximum(self.dof, outputs + 1.0)
        return np.linalg.inv(np.linalg.cholesky(self.C)) * np.sqrt(2 * (nu - outputs) / nu)[:, None, None]

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """``n`` random errors (2 N Y, n), whitened with a covariance estimate of the same uncertainty."""
        if self.parts:
            drawn = [p.draw(rng, n).reshape(2, -1, n) for p in self.parts]  # real parts, then imaginary
            return np.concatenate(drawn, axis=1).reshape(-1, n)
        return self._null_draws(rng, n)

    def joint_draws(self, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Errors and estimates of their precision together; see `NullDraws.joint`."""
        if self.parts:
            errors, roots = zip(*(p.joint_draws(rng, n) for p in self.parts), strict=True)
            return np.concatenate(errors), np.concatenate(roots)
        return self._null_draws.joint(rng, n)

    @property
    def _null_draws(self) -> NullDraws:
        return NullDraws(self.dof, self.pooling, self.C.shape[-1])

    @property
    def definite(self) -> bool:
        """Whether every covariance is positive definite; those of a simulation without noise are not."""
        determinant, power = np.linalg.det(self.C).real, self.variance.prod(axis=1)
        return bool(np.all(determinant > 1e-9 * power) and np.all(power > 0))

    def times(self, factor: np.ndarray) -> LineNoise:
        """The noise of responses with ``factor`` (N,) times the variance."""
        parts = tuple(p.times(x) for p, x in zip(self.parts, self._by_part(factor), strict=True))
        return replace(self, C=self.C * factor[:, None, None], parts=parts)

    def with_fewer(self, share: np.ndarray) -> LineNoise:
        """The same covariance of one recording, estimated with a ``share`` (N,) of the degrees of freedom."""
        pooling = self.pooling
        if pooling is not None and pooling.records is not None:
            pooling = replace(pooling, records=max(1, round(pooling.records * float(np.median(share)))))
        return replace(self, dof=self.dof * share, pooling=pooling)

    def plus(self, other: LineNoise) -> LineNoise:
        """The noise of a difference of two responses whose covariances come from one estimate."""
        parts = tuple(a.plus(b) for a, b in zip(self.parts, other.parts, strict=True))
        return replace(self, C=self.C + other.C, parts=parts)

    def at(self, keep: np.ndarray) -> LineNoise:
        """At some of the lines, (N,) bool."""
        if self.parts:
            return LineNoise.joined([p.at(k) for p, k in zip(self.parts, self._by_part(keep), strict=True)])
        pooling = None if self.pooling is None else self.pooling.at_lines(keep)
        return replace(self, C=self.C[keep], dof=self.dof[keep], pooling=pooling)

    def _by_part(self, values: np.ndarray) -> list[np.ndarray]:
        """Values of the lines, (N,), by part."""
        return np.split(values, np.cumsum([p.dof.size for p in self.parts])[:-1]) if self.parts else []
