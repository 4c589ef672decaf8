"""The base model's lowest minimum is found although most starts end elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcstudy.lines.base_fit import APART, base_fit, drawn_starts
from mcstudy.lines.priors import opened
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment

OPEN = opened(two_segment())


@pytest.mark.parametrize(
    "effects",
    [{}, {"passive_damping_ankle": {"Bpas1": 90.0}}, {"sensor_lag_theta1": {"tau_theta1": 0.004}}],
    ids=["nothing missing", "passive damping", "sensor lag"],
)
def test_no_start_of_five_hundred_ends_lower(with_effects: Callable[..., Lines], effects: dict[str, dict]) -> None:
    fit = base_fit(with_effects(3, effects), two_segment(), seed=0)
    fitter, best, minima = fit.fitter, fit.best, fit.minima
    widely = fitter.fits(fitter.packed(fit.data), drawn_starts(OPEN, 1, 500)).objective
    assert best.chi2 + best.penalty <= widely.min() + 0.1
    assert np.median(widely) > best.chi2 + best.penalty + 1.0, "every start ends there: nothing is tested"
    np.testing.assert_allclose(minima[0], best.theta, rtol=1e-2)
    apart = np.abs((minima[:, None] - minima) / fitter.prior.scale).max(axis=2)
    assert (apart[np.triu_indices(len(minima), 1)] > APART).all()
