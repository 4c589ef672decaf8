"""The paper's statements about its model and noise alone: sensitivity (Fig. 7C) and noise-evoked sway.

They follow in closed form from the true values, so ours have no Monte Carlo error.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.paper import published
from mcstudy.analysis.paper.accuracy_rows import DAMPINGS, STIFFNESSES, lead, leaders
from mcstudy.analysis.paper.sampling import Value, exact
from mcstudy.analysis.sensitivity import influence, sensitivity
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SensorNoise, record_frequencies
from mcstudy.stance.simulate_spectral import sway_psd

EQUAL_SHARE = 100 / 12
"""Share of each of 12 parameters that all matter equally, percent."""


def influences(model: Model, f: np.ndarray) -> tuple[xr.DataArray, xr.DataArray]:
    """Per parameter: its influence over all ranges, and whether its share is largest in the high range."""
    share = sensitivity(model, model.truth, f)["share"]
    others = share.sel(range=[r for r in share["range"].values if r != "high"]).max("range")
    high = share.sel(range="high", drop=True) if "high" in share["range"] else others * 0
    return influence(model, model.truth, f), high > others


def sensitivity_values(model: Model, f: np.ndarray) -> dict[str, Value]:
    """Rows about Fig. 7C at the truth of ``model``; ``f``: (N,) Hz, points that reach all three ranges."""
    matter = influence(model, model.truth, f)
    share = 100 * sensitivity(model, model.truth, f)["share"]
    low, mid, high = (share.sel(range=r, drop=True) for r in ("low", "mid", "high"))
    delays, stiff, damp = list(published.DELAYS), list(STIFFNESSES), list(DAMPINGS)
    least = published.LEAST_INFLUENTIAL

    def of(names: list[str]) -> str:
        shares = [f"{n} " + "/".join(f"{float(x.sel(parameter=n)):.2g}" for x in (low, mid, high)) for n in names]
        return ", ".join(shares) + " % at low/mid/high frequencies"

    return {
        "least_influential": exact(float(lead(matter, least, False)), leaders(matter, len(least) + 1, False)),
        "delays_low": exact(float(low.sel(parameter=delays).max()), of(delays)),
        "delays_high": exact(float(high.sel(parameter=delays).min()), of(delays)),
        "delays_most_high": exact(float((high - np.maximum(low, mid)).sel(parameter=delays).min()), of(delays)),
        "stiffness_low": exact(float((low - high).sel(parameter=stiff).min()), of(stiff)),
        "damping_high": exact(float((high - low).sel(parameter=damp).min()), of(damp)),
    }


def sway_rms(
    model: Model, theta: np.ndarray, noise: SensorNoise, record_s: float, cycles: int, rate_hz: float
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


def sway_values(model: Model, noise: SensorNoise, record_s: float, cycles: int, rate_hz: float) -> dict[str, Value]:
    """Rows about the sway evoked by noise alone, at the truth of ``model``, for records of ``record_s`` seconds.

    The paper's error is that of a mean over its 50 records.
    """
    whole, scatter, window = sway_rms(model, model.truth, noise, record_s, cycles, rate_hz)
    one = scatter / np.sqrt(published.REALIZATIONS)
    out = {}
    for i, error in enumerate(one):
        detail = f"one record scatters by {scatter[i]:.2g} deg"
        out[f"sway_{i + 1}"] = exact(whole[i], detail, float(error))
        out[f"sway_{i + 1}_cycle"] = exact(window[i], one=float(error))
    return out
