"""The paper's statements about its model and noise alone: sensitivity (Fig. 7C) and noise-evoked sway.

They follow in closed form from the true values, so ours have no Monte Carlo error.
"""

from __future__ import annotations

import numpy as np

from mcstudy.analysis.publications.sampling import Value, exact
from mcstudy.analysis.sensitivity import sensitivity
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import Noise, record_frequencies
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy_goodworth2018.paper import published
from mcstudy_goodworth2018.paper.accuracy_rows import DAMPINGS, STIFFNESSES, TWELVE, lead, leaders

EQUAL_SHARE = 100 / 12
"""Share of each of 12 parameters that all matter equally, percent."""


def influences(model: Model, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Per parameter (`TWELVE`,): its influence over all ranges, and whether its share is largest in the high range."""
    found = sensitivity(model, model.truth, f).sel(parameter=list(TWELVE))
    share = found["share"]
    highest = share["range"].values[share.argmax("range").values]
    return found["value"].mean(("range", "direction")).values, highest == "high"


def sensitivity_values(model: Model, f: np.ndarray) -> dict[str, Value]:
    """Rows about Fig. 7C at the truth of ``model``; ``f``: (N,) Hz, points that reach all three ranges."""
    matter = influences(model, f)[0]
    share = 100 * sensitivity(model, model.truth, f)["share"]

    def of(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
        low, mid, high = (share.sel(range=r, parameter=list(names)).values for r in ("low", "mid", "high"))
        text = [f"{n} {a:.2g}/{b:.2g}/{c:.2g}" for n, a, b, c in zip(names, low, mid, high, strict=True)]
        return low, mid, high, ", ".join(text) + " % at low/mid/high frequencies"

    least = published.LEAST_INFLUENTIAL
    low, mid, high, delays = of(published.DELAYS)
    stiff_low, _, stiff_high, stiffnesses = of(STIFFNESSES)
    damp_low, _, damp_high, dampings = of(DAMPINGS)
    return {
        "least_influential": exact(
            float(lead(matter, TWELVE, least, False)), leaders(matter, TWELVE, len(least) + 1, False)
        ),
        "delays_low": exact(low.max(), delays),
        "delays_high": exact(high.min(), delays),
        "delays_most_high": exact((high - np.maximum(low, mid)).min(), delays),
        "stiffness_low": exact((stiff_low - stiff_high).min(), stiffnesses),
        "damping_high": exact((damp_high - damp_low).min(), dampings),
    }


def sway_rms(
    model: Model, theta: np.ndarray, noise: Noise, record_s: float, cycles: int, rate_hz: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Root mean square of the zero-mean sway that the noise alone evokes, degrees, each (2,).

    Returns
    -------
    over the whole record; its standard deviation between records; over one of its ``cycles`` windows, each with its
    own mean removed.

    A record is one period of a process with independent coefficients at k / record_s; the mean square is the sum of
    the powers, and removing the mean of a window of T / cycles leaves the fraction 1 - sinc^2(k / cycles) of each.
    """
    n = round(record_s * rate_hz)
    f = record_frequencies(n, rate_hz)[1:]
    psd = sway_psd(model, theta, noise, f)
    power = np.einsum("nii->ni", psd).real / record_s
    kept = 1 - np.sinc(f * record_s / cycles) ** 2
    whole = np.sqrt(power.sum(0))
    scatter = np.sqrt((power**2).sum(0)) / (2 * whole)
    window = np.sqrt((power * kept[:, None]).sum(0))
    return np.degrees(whole), np.degrees(scatter), np.degrees(window)


def sway_values(model: Model, noise: Noise, record_s: float, cycles: int, rate_hz: float) -> dict[str, Value]:
    """Rows about the sway evoked by noise alone, at the truth of ``model``, for records of ``record_s`` seconds.

    The paper's error is that of a mean over its 50 records.
    """
    whole, scatter, window = sway_rms(model, model.truth, noise, record_s, cycles, rate_hz)
    one = scatter / np.sqrt(published.REALIZATIONS)
    out = {}
    for i, error in enumerate(one):
        detail = f"one record scatters by {scatter[i]:.2g} deg"
        out[f"sway_{i + 1}"] = exact(whole[i], detail, float(error))
        out[f"sway_{i + 1}_cycle"] = exact(window[i], study_error=float(error))
    return out
