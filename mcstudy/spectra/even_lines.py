"""The noise covariance of a mean spectrum at its odd lines, from the even lines around them.

The stimulus excites only odd harmonics, so the even lines of the mean spectrum contain only noise (for a linear
subject; an even-order nonlinearity would also appear here). They have the variance of the *mean*. The scatter between
five cycles does not (wrong by a factor of 2 at 1 Hz and 4 above 4 Hz), because consecutive cycles are not independent.

The 2 x 2 covariance at an odd line is a local average of outer products over neighbouring even lines after
prewhitening. Sway spectra decrease by 80 dB from 0.02 to 8 Hz, have a resonance ten lines wide, and the two angles have
a coherence of up to 0.999. A plain average over more than a few lines would therefore mix different spectra and make
the small eigenvalue of the covariance several times too large. The lines are whitened in two steps before averaging,
and both steps are reversed exactly at the odd line (prewhitening and recolouring; the combination is derived here):

1. multiplication of each line by the square root of its number, which flattens pink noise at the lowest lines, where
   all neighbours are on one side and a slope would cause a bias;
2. a vector autoregression fitted to the even lines by least squares (Yule-Walker), which models resonances and the
   phase between the angles.

The window is parabolic with a half-width of 10 + k/5 lines, at most 30, at line k: narrow at low lines, where the
spectrum is still curved after whitening, and wide where it is smooth. ``dof`` states its equivalent number of
independent complex lines (twice as many real degrees of freedom): 4.6 at the first line, 26 from 4 Hz up.

Found with the stand-in truth, lines drawn from its sway density: mean estimate over true covariance is 0.87-1.12 in
every direction at every line, although the two directions differ by 30 dB; a plain average over +-10 lines is off by
factors of 0.2 to 5. Weighting a fit by the estimate costs 7 % in standard deviation against the true covariance, the
plain average 22 %. Step 1 assumes sway-like noise. With white noise at the lowest lines the estimate at line 1 would
be four times too large, with brown noise three times too small; ``any_colour`` estimates the slope and removes it in
step 1 (`mcstudy.spectra.colour`).
"""

from __future__ import annotations

import numpy as np

from mcstudy.errors import InputError
from mcstudy.spectra.colour import Colour
from mcstudy.spectra.window import parabolic

MAX_ORDER = 10
"""Largest order of the vector autoregression; fewer even lines than 6 per order reduce it."""


def half_width(line: np.ndarray) -> np.ndarray:
    """Half-width of the averaging window at harmonic ``line``, in harmonics."""
    return np.minimum(10.0 + line / 5.0, 30.0)


class EvenLineCovariance:
    """Estimator of the noise covariance at given odd lines, with everything that depends on line numbers done once.

    Parameters
    ----------
    lines: odd harmonics at which the covariance is wanted, (L,) int.
    n_harmonics: highest harmonic available (coefficients 0 ... n_harmonics are passed in).
    any_colour: None for sway-like noise. For noise of any colour: number of trials, and number of further records from
        which the colour is estimated.

    Attributes
    ----------
    even: the even harmonics used, (E,) int.
    dof: equivalent number of independent complex lines averaged at each line of one trial, (L,).

    Raises `InputError` when a line is even, below 1 or not available, or when fewer than four even lines are.
    """

    def __init__(self, lines: np.ndarray, n_harmonics: int, any_colour: tuple[int, int] | None = None) -> None:
        self.lines = np.asarray(lines, dtype=np.int64)
        if self.lines.size == 0 or (self.lines % 2 == 0).any() or self.lines.min() < 1:
            raise InputError("noise covariance: expected odd harmonics from 1 up")
        if self.lines.max() > n_harmonics:
            raise InputError(f"noise covariance: harmonic {self.lines.max()} is above the highest, {n_harmonics}")
        # A tenth more than the window needs: a real autoregression has zero slope and phase at the edge of its band.
        top = int(1.1 * self.lines.max() + half_width(self.lines.max()))
        self.even = np.arange(2, min(top, n_harmonics) + 1, 2)
        if self.even.size < 4:
            raise InputError(f"noise covariance: expected at least four even harmonics, got {self.even.size}")
        self._window = parabolic(self.lines, self.even, half_width(self.lines) + 1.0)
        self.dof = 1.0 / (self._window**2).sum(axis=1)
        self._colour = None
        if any_colour is not None:
            trials = any_colour[0]
            self._colour = Colour(self.even, self.lines, any_colour)
            self.dof = self._colour.dof(self.dof * trials) / trials
        self.order = min(MAX_ORDER, self.even.size // 6)
        self._level_even, self._level_lines = np.sqrt(self.even), np.sqrt(self.lines)
        self._shift_even, self._shift_lines = self._shift(self.even), self._shift(self.lines)

    def __call__(self, coefficients: np.ndarray, records: np.ndarray | None = None) -> np.ndarray:
        """Covariance E[n n^H] of the noise on the mean of the trials, (L, A, A) complex Hermitian.

        ``coefficients``: Fourier coefficients of the mean period at harmonics 0, 1, ..., of A angles in one trial,
        (K, A), or in T trials of equal length, (T, K, A); trials are pooled, and their mean has 1/T of their
        covariance and T times the degrees of freedom. ``records`` (D, K, A): further records whose noise has the same
        colour but possibly another level.
        """
        trials = coefficients[None] if coefficients.ndim == 2 else coefficients
        n_angles = trials.shape[-1]
        x, restored = trials[:, self.even] * self._level_even[:, None], np.ones((self.lines.size, n_angles))
        if self._colour is not None:
            exponent = self._exponent(self._colour, trials, records)
            x, restored = x * self._colour.levelled(exponent).T, self._colour.restored(exponent).T
        x, scale, regression = self._regressed(x)
        white = x - np.einsum("ep,pab,teb->tea", self._shift_even, regression, x)
        products = np.einsum("tea,teb->eab", white, white.conj()) / len(trials)
        # einsum, not @: for so small a product BLAS threads cost more than they save, and their number would change the
        # last bits of the result.
        local = np.einsum("le,ek->lk", self._window, products.reshape(self.even.size, -1).view(np.float64))
        local = local.view(np.complex128).reshape(-1, n_angles, n_angles)
        colour = np.linalg.inv(np.eye(n_angles) - np.einsum("lp,pab->lab", self._shift_lines, regression))
        colour = (restored * scale / self._level_lines[:, None])[:, :, None] * colour
        covariance = colour @ local @ colour.conj().swapaxes(-1, -2) / len(trials)
        return (covariance + covariance.conj().swapaxes(-1, -2)) / 2

    def _exponent(self, colour: Colour, trials: np.ndarray, records: np.ndarray | None) -> np.ndarray:
        """Exponent (A,) of the noise at the lowest lines, relative to the pink noise that step 1 assumes."""
        kinds = [trials] if records is None else [trials, records]
        power = [(np.abs(x[:, self.even]) ** 2).mean(axis=0).T * self.even for x in kinds]
        return colour.exponent(np.array(power))

    def whitening(self, trials: np.ndarray, harmonics: np.ndarray) -> np.ndarray:
        """Matrices (H, A, A) that whiten coefficients at any ``harmonics`` (H,) up to the highest even line used.

        ``trials``: (T, K, A), whose even lines give the autoregression.
        """
        _, scale, regression = self._regressed(trials[:, self.even] * self._level_even[:, None])
        white = np.eye(scale.size) - np.einsum("hp,pab->hab", self._shift(harmonics), regression)
        return np.asarray(white * np.sqrt(harmonics)[:, None, None] / scale)

    def _shift(self, harmonics: np.ndarray) -> np.ndarray:
        """Powers (H, order) of the shift by one lag; the analysed band counts as the whole Nyquist band."""
        angle = -np.pi / (self.even[-1] + 1)
        return np.exp(1j * angle * np.outer(harmonics, np.arange(1, self.order + 1)))

    def _regressed(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Step 2: levelled even lines (T, E, A) with their scale (A,) taken out, the scale, and the regression."""
        # For numerical reasons: channels differ by orders of magnitude, and a channel may be identically zero.
        scale = np.sqrt(np.mean(np.abs(x) ** 2, axis=(0, 1)))
        scale = np.where(scale > 0, scale, 1.0)
        x = x / scale
        return x, scale, self._autoregression(x)

    def _autoregression(self, x: np.ndarray) -> np.ndarray:
        """Coefficients (order, A, A) of x ~ sum_j R_j z^j x over the even lines of all trials (T, E, A).

        Yule-Walker: with the autocovariances S_d = Re sum z^d x x^H, the equations are sum_j R_j S_(j-i) = S_(-i).
        """
        n, p = x.shape[-1], self.order
        if p == 0:
            return np.zeros((0, n, n))
        products = np.einsum("tea,teb->eab", x, x.conj())
        lags = np.concatenate([np.ones((self.even.size, 1)), self._shift_even], axis=1)
        forward = np.einsum("ed,eab->dab", lags, products).real
        gram = np.empty((p, n, p, n))
        for j in range(p):
            for i in range(p):
                gram[j, :, i] = forward[j - i] if j >= i else forward[i - j].T
        target = forward[1:].transpose(1, 2, 0)  # S_(-i) = S_i^T; rows of the solution are columns of R^T
        solution = np.linalg.lstsq(
            gram.reshape(p * n, p * n).T, target.transpose(2, 0, 1).reshape(p * n, n), rcond=None
        )[0]
        return solution.reshape(p, n, n).transpose(0, 2, 1)
