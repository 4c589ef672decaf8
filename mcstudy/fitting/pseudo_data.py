"""Data of any outputs as data of the angles, so that the compiled fits know angles alone.

Outputs y = C F h + d, with F h the R angles as measured, make the weighted residual W (C F h + d - y) of a frequency.
With M = W C, its square is that of L (F h - h0) and a constant, where M = Q L, Q with orthonormal columns, L lower
triangular, and h0 = M^+ W (y - d): the same cost with the same derivatives. Where there are fewer outputs than angles,
the first rows of L are zero. Derived.
"""

from __future__ import annotations

import numpy as np

from mcstudy.fitting.arguments import pack
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import output_matrices


def packed(model: Model, f: np.ndarray, y: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Outputs ``y`` (N, Y) with weights (N, Y, Y) at frequencies ``f`` (N,) in the kernel's order, see `pack`."""
    return pack(*folded(model, f, y, weight)) if model.outputs else pack(y, weight)


def folded(model: Model, f: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Pseudo-data h0 (N, R), their weights L (N, R, R), and the part of the cost that no parameter changes.

    All NaN where data or weights are not finite.
    """
    if not (np.isfinite(y).all() and np.isfinite(weight).all()):
        R = model.n_rows
        return np.full((len(y), R), np.nan + 0j), np.full((len(y), R, R), np.nan + 0j), np.nan
    C, d = output_matrices(model, 2j * np.pi * np.asarray(f, dtype=float))
    M, whitened = weight @ C, np.einsum("nij,nj->ni", weight, y - d)
    h0 = np.einsum("nij,nj->ni", np.linalg.pinv(M), whitened)
    missed = whitened - np.einsum("nij,nj->ni", M, h0)
    return h0, lower_factor(M), float((np.abs(missed) ** 2).sum())


def lower_factor(M: np.ndarray) -> np.ndarray:
    """L (N, R, R) with L^H L = M^H M of M (N, Y, R), lower triangular with a real diagonal that is not negative."""
    N, Y, R = M.shape
    L = np.zeros((N, R, R), dtype=complex)
    L[:, max(0, R - Y) :] = np.asarray(np.linalg.qr(M[:, :, ::-1], mode="r"))[:, ::-1, ::-1]
    diagonal = np.einsum("nii->ni", L)
    size = np.abs(diagonal)
    turn = np.where(size > 0, diagonal.conj() / np.where(size > 0, size, 1.0), 1.0)
    L *= turn[:, :, None]
    np.einsum("nii->ni", L)[:] = size
    return L
