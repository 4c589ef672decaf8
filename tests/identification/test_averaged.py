"""Parameters averaged over causes: the pool of distributions, what a smooth deviation does, and both together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, minimize
from scipy.stats import multivariate_normal, norm

import mcstudy as mc
from mcstudy.errors import InputError
from mcstudy.fitting.arguments import Prior
from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.identification.averaged_record import Averaged
from mcstudy.identification.deviation import Deviations
from mcstudy.identification.mixture import NODES, distribution, on_bound, quantiles
from mcstudy.identification.outside import Coloured, Problem
from mcstudy.identification.profile import Linearised
from mcstudy.lines.priors import weak_prior
from mcstudy.models.quantities import quantities
from mcstudy.stance.body import two_segment


@pytest.fixture(scope="module")
def lagged() -> mc.FitResult:
    return mc.fit(mc.simulate({"sensor_lag_theta1": 0.02}, cycles=5, seed=2, rate_hz=100), fmax=3.0)


def test_one_explanation_alone_gives_its_profile_likelihood_interval(fits: dict[str, mc.FitResult]) -> None:
    fit = fits["short"]
    for e in fit.estimates:
        rise = max(e.profile.rise)
        values = distribution(e.profile, e.estimate, rise, fit.level)
        low, high = quantiles(values[None], np.ones(1), (0.025, 0.975))
        if e.low_from == e.high_from == "data" and np.isclose(e.profile.rise[[0, -1]], rise).all():
            np.testing.assert_allclose([low, high], [e.low, e.high], atol=1e-2 * (e.high - e.low))
        elif e.low_from == "bound" and e.estimate == e.low:
            assert (low, on_bound(values[None], np.ones(1), low)) == (e.low, True)


def test_the_pool_of_normal_distributions_has_the_quantiles_of_their_mixture() -> None:
    mean, sd, weight = np.array([0.0, 3.0, -1.0]), np.array([1.0, 0.5, 2.0]), np.array([0.7, 0.2, 0.1])
    found = quantiles(mean[:, None] + np.outer(sd, NODES), weight, (0.025, 0.5, 0.975))

    def below(q: float, p: float) -> float:
        return float(weight @ norm.cdf(q, mean, sd)) - p

    exact = [brentq(below, -20, 20, args=(p,)) for p in (0.025, 0.5, 0.975)]
    np.testing.assert_allclose(found, exact, atol=5e-3)


def test_a_deviation_moves_and_widens_as_generalised_least_squares_does(fits: dict[str, mc.FitResult]) -> None:
    fit = fits["short"]
    data, wanted = Data.of(fit.lines), quantities(fit.model)
    near = Linearised.at(fit.model, fit.minima, wanted)
    prior = weak_prior(fit.model, fit.model)._replace(weight=0.0)
    fitted = Fitted(fit.model, prior, fit.theta, fit.chi2, 0.0, fit.minima.information[0])
    J, r = fitted.jacobian(data)[:, near.free], fitted.residual(data)
    found = Deviations(fitted, data, near).sized()
    family = free_torques(fitted, data)[0]
    for one, size in zip(found, family.variances, strict=False):
        V = np.eye(r.size) + size * family.columns @ family.columns.T
        A = J.T @ np.linalg.solve(V, J)
        g = near.gradients[:, near.free]
        np.testing.assert_allclose(one.shift, g @ np.linalg.solve(A, J.T @ np.linalg.solve(V, r)), rtol=1e-5, atol=1e-7)
        whole = np.einsum("kp,pk->k", g, np.linalg.solve(A, g.T))
        np.testing.assert_allclose(np.nan_to_num(near.variance) + one.variance, whole, rtol=1e-6)
        wide = 1e6 * J @ np.linalg.inv(J.T @ J) @ J.T  # a flat prior, as wide as numbers allow
        own, other = (multivariate_normal(cov=C + wide).logpdf(r) for C in (V, np.eye(r.size)))
        assert one.log_factor == pytest.approx(own - other, abs=1e-3)


def test_a_refitted_deviation_ends_at_the_minimum_that_scipy_finds(fits: dict[str, mc.FitResult]) -> None:
    fit = fits["short"]
    data, own = Data.of(fit.lines), weak_prior(fit.model, fit.model)
    problem = Problem(fit.model, Prior(own.mean, 4 * own.scale), data)
    r, J = problem.at(fit.theta)
    F = free_torques(Fitted(fit.model, problem.prior, fit.theta, fit.chi2, 0.0, J.T @ J), data)[0].columns
    V = np.eye(r.size) + 0.01 * F @ F.T

    def cost(x: np.ndarray) -> float:
        theta = x * own.scale
        off = (theta - own.mean) / (4 * own.scale)
        left = problem.residual(theta)
        return float(left @ np.linalg.solve(V, left) + off @ off)

    theta, _, _ = Coloured(problem, F, 0.01).refitted(fit.theta)
    bounds = list(zip(fit.model.lower / own.scale, fit.model.upper / own.scale, strict=True))
    least = minimize(cost, fit.theta / own.scale, method="L-BFGS-B", bounds=bounds)
    assert cost(fit.theta / own.scale) > least.fun + 0.1
    assert cost(theta / own.scale) < least.fun + 0.05


def test_where_there_is_a_gap_the_average_holds_the_truth_that_the_model_as_it_is_misses(lagged: mc.FitResult) -> None:
    truth = dict(zip(lagged.model.names, two_segment().truth, strict=True))
    a = lagged.averaged
    assert isinstance(a, Averaged)
    missed = [e.name for e in lagged.estimates if e.name in truth and not e.low <= truth[e.name] <= e.high]
    still = [q.name for q in a.quantities if q.name in truth and not q.low <= truth[q.name] <= q.high]
    assert len(missed) >= 2
    assert not still


def test_weights_and_parts_of_variances_are_shares(lagged: mc.FitResult) -> None:
    a = lagged.averaged
    assert a is not None
    assert sum(c.probability for c in a.causes) == pytest.approx(1)
    for q in a.quantities:
        assert q.data + q.form + q.cause == pytest.approx(1)
        assert min(q.data, q.form, q.cause) >= -1e-12
        assert q.low <= q.estimate <= q.high


def test_without_a_gap_there_is_no_average_unless_it_is_wanted(fits: dict[str, mc.FitResult]) -> None:
    assert fits["good"].averaged is None
    assert fits["effect added"].averaged is None
    wanted = mc.fit(mc.simulate(seed=11, cycles=6), fmax=3.0, causes=True).averaged
    assert wanted is not None
    assert wanted.causes[0].name == "nothing missing"


def test_an_average_beside_added_effects_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="causes: expected"):
        mc.fit(mc.simulate(seed=11, cycles=3), causes=True, effects=["passive_damping_ankle"])


def test_a_declared_model_is_averaged_over_the_effects_that_it_may_lack() -> None:
    a = mc.fit(mc.simulate(seed=4, cycles=4, model="elbow"), model="elbow", causes=True).averaged
    assert a is not None
    assert a.causes[0].name == "nothing missing"
    assert len(a.causes) > 3
