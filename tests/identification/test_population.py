"""Means, spread and differences of people from their likelihoods."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from examples import module
from scipy import integrate, optimize, stats

from mcstudy.identification.people.likelihood import Likelihood, difference, hull
from mcstudy.identification.people.population import Population
from mcstudy.identification.people.two_means import paired, unpaired

VACCINATED = np.array(
    [
        [4, 6, 3, 62, 33, 180, 8, 505, 29, 17, 186, 5, 27],
        [119, 300, 228, 13536, 5036, 1361, 2537, 87886, 7470, 1699, 50448, 2493, 16886],
    ]
)
NOT = np.array(
    [
        [11, 29, 11, 248, 47, 372, 10, 499, 45, 65, 141, 3, 29],
        [128, 274, 209, 12619, 5761, 1079, 619, 87892, 7232, 1600, 27197, 2338, 17825],
    ]
)
"""Cases and others with and without BCG vaccine, 13 trials (Colditz et al. 1994), the example of Viechtbauer (2010)."""


def gaussian(value: float, error: float) -> Likelihood:
    """Of a value with a standard error."""
    root = np.array([-1.0, 0.0, 1.0])
    return Likelihood(value + error * root, root, value)


def bcg() -> Population:
    risks = [group[0] / group.sum(axis=0) for group in (VACCINATED, NOT)]
    variance = sum(1 / group[0] - 1 / group.sum(axis=0) for group in (VACCINATED, NOT))
    y = np.log(risks[0] / risks[1])
    return Population([gaussian(m, s) for m, s in zip(y, np.sqrt(variance), strict=True)], 0.95)


@pytest.fixture(scope="module")
def trials() -> Population:
    return bcg()


def box(low: float, high: float) -> Likelihood:
    """A value of which only its bounds are known."""
    return Likelihood(
        np.array([low, (low + high) / 2, high]), np.zeros(3), (low + high) / 2, "bound", "bound", open=(True, True)
    )


def test_mean_and_spread_are_the_published_ones_of_the_bcg_trials(trials: Population) -> None:
    """REML: -0.7145 and tau^2 = 0.3132 (Viechtbauer 2010, J Stat Softw 36(3), model res)."""
    assert trials.mean().value == pytest.approx(-0.7145, abs=0.0015)
    assert trials.between().value ** 2 == pytest.approx(0.3132, abs=0.0010)


def test_the_interval_of_the_mean_is_that_of_the_profile_likelihood_with_a_free_scale(trials: Population) -> None:
    """The Gaussian random-effects likelihood in closed form, maximised by another optimiser."""
    y = np.array([p.estimate for p in trials.people])
    v = np.array([p.width**2 for p in trials.people])

    def log(mu: float, tau2: float, scale: float) -> float:
        return float(stats.norm.logpdf(y, mu, np.sqrt(scale * (v + tau2))).sum())

    def best(mu: float) -> float:
        starts = ((-1.0, 0.0), (-3.0, 1.0), (2.0, -3.0))
        found = [optimize.minimize(lambda x: -log(mu, *np.exp(x)), x0, method="Nelder-Mead") for x0 in starts]
        return -min(f.fun for f in found)

    top = -optimize.minimize_scalar(lambda mu: -best(mu), bounds=(-2, 1), method="bounded").fun
    t = stats.t.ppf(0.975, y.size - 1)
    goal = y.size * np.log1p(t**2 / (y.size - 1))
    ends = [optimize.brentq(lambda mu: 2 * (top - best(mu)) - goal, *side) for side in ((-2, -0.7), (-0.7, 1))]
    found = trials.mean()
    np.testing.assert_allclose([found.low, found.high], ends, atol=0.003)


def test_stated_errors_that_are_too_large_make_no_difference_too_uncertain() -> None:
    """Where they explain all scatter, the scatter that is seen counts: type I error 5 %, not 0.5."""
    rng, n = np.random.default_rng(7), 300
    found = {1.0: 0, 1.4: 0}
    for _ in range(n):
        size = rng.uniform(0.7, 1.4, 6)
        values = size * rng.standard_normal(6)
        for factor in found:
            people = [gaussian(v, factor * w) for v, w in zip(values, size, strict=True)]
            found[factor] += paired(Population(people, 0.95)).p_value <= 0.05
    assert all(stats.binomtest(hits, n, 0.05).pvalue > 1e-3 for hits in found.values()), found


def random_people(rng: np.random.Generator) -> list[Likelihood]:
    """Of some, both or no side of the likelihood is a bound; some are flat in the middle."""
    out = []
    for _ in range(int(rng.integers(2, 9))):
        at, width = rng.normal(0.6, 1.0), rng.uniform(0.3, 2.0)
        ends = rng.choice(["data", "bound"], 2, p=[0.7, 0.3])
        root = np.array([-2.0, -rng.uniform(0.05, 1.0), 0.0, rng.uniform(0.05, 1.0), 2.0])
        open_ = ends[0] == "bound", ends[1] == "bound"
        value = at + width * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
        out.append(Likelihood(value, root, at, str(ends[0]), str(ends[1]), open=open_))
    return out


@pytest.mark.parametrize("seed", range(25))
def test_p_is_below_the_level_exactly_where_the_interval_does_not_hold_zero(seed: int) -> None:
    rng = np.random.default_rng(seed)
    level = float(rng.choice([0.8, 0.9, 0.95]))
    a, b = (Population(random_people(rng), level) for _ in range(2))
    for found in (paired(a), unpaired(b, a)):
        held = found.interval.low <= 0 <= found.interval.high
        assert (found.p_value >= 1 - level) == held
        assert 0 < found.p_value <= 1


def test_p_of_a_paired_difference_is_the_level_of_the_interval_that_ends_at_zero() -> None:
    people = Population([gaussian(v, w) for v, w in ((1.2, 0.5), (0.1, 1.0), (2.0, 0.7), (0.9, 0.4))], 0.95)
    p = paired(people).p_value
    wider, narrower = (people.mean(1 - factor * p) for factor in (0.99, 1.01))
    assert wider.low <= 0 <= wider.high
    assert not narrower.low <= 0 <= narrower.high


def test_few_people_without_error_have_the_t_interval() -> None:
    x = np.array([9.0, 10.5, 11.0, 8.2, 12.4])
    found = Population([gaussian(v, 0.02) for v in x], 0.95)
    interval = stats.t.interval(0.95, x.size - 1, x.mean(), stats.sem(x))
    np.testing.assert_allclose(found.mean()[:3], [x.mean(), *interval], rtol=1e-3)
    assert found.between().value == pytest.approx(x.std(ddof=1), rel=2e-3)


def test_an_unpaired_difference_of_exact_values_is_that_of_welch() -> None:
    x, y = np.array([9.0, 10.5, 11.0, 8.2, 12.4]), np.array([11.1, 12.0, 12.7, 11.9])
    a, b = (Population([gaussian(v, 0.02) for v in z], 0.95) for z in (x, y))
    expected = stats.ttest_ind(y, x, equal_var=False)
    found = unpaired(b, a)
    np.testing.assert_allclose(found.interval[1:3], expected.confidence_interval(), atol=0.02)
    assert found.p_value == pytest.approx(expected.pvalue, rel=0.02)


def test_a_paired_difference_removes_what_people_have_in_common() -> None:
    rng = np.random.default_rng(3)
    level, change = rng.normal(1000, 200, 8), rng.normal(50, 10, 8)
    first, second = ([gaussian(v, 15.0) for v in z] for z in (level, level + change))
    own = Population([difference(b, a) for a, b in zip(first, second, strict=True)], 0.95)
    found = paired(own)
    expected = stats.ttest_rel(level + change, level)
    assert found.interval.value == pytest.approx(change.mean(), abs=0.5)
    assert found.interval.low < 50 < found.interval.high
    assert found.p_value == pytest.approx(expected.pvalue, rel=0.1)
    across = unpaired(Population(second, 0.95), Population(first, 0.95)).interval
    assert across.high - across.low > 5 * (found.interval.high - found.interval.low)


def test_the_likelihood_of_a_difference_of_gaussians_is_gaussian() -> None:
    found = difference(gaussian(5.0, 2.0), gaussian(1.0, 1.0))
    x = np.array([-1.0, 2.0, 4.0, 9.0])
    np.testing.assert_allclose(found.log(x), -((x - 4) ** 2) / 10, atol=1e-3)
    assert not any(found.open)
    np.testing.assert_allclose(found.flat, 4.0, atol=0.02)


def test_flat_likelihoods_give_a_flat_difference() -> None:
    found = difference(box(0, 2), box(0, 3))
    np.testing.assert_allclose(found.log(np.linspace(-2.9, 1.9, 5)), 0, atol=1e-9)
    assert (found.log(np.array([-3.1, 2.1])) == -np.inf).all()
    assert found.open == (True, True)


def test_people_of_whom_only_bounds_are_known_do_not_determine_a_mean() -> None:
    """Ten intervals of a fit that bounds end are one such interval, not one that is narrower by the root of ten."""
    found = Population([box(0, 700 + 10 * k) for k in range(10)], 0.95, (0.0, 800.0)).mean()
    assert (found.low, found.high) == (0.0, 790.0)
    assert (found.low_from, found.high_from) == ("bound", "bound")


def test_people_whose_likelihoods_are_flat_may_all_lie_at_the_same_end() -> None:
    """The ends of the flat parts are the true means when a trade between parameters is settled at a bound."""
    rng = np.random.default_rng(2)
    top = rng.normal(1200, 150, 10)
    people = [
        Likelihood(np.array([t - 750, t - 700, t - 300, t, t + 50]), np.array([-2.0, -0.1, 0.0, 0.1, 2.0]), t - 300)
        for t in top
    ]
    found = Population(people, 0.95).mean()
    assert found.low < top.mean() - 650
    assert found.high > top.mean() - 50
    assert (found.low_from, found.high_from) == ("flat", "flat")


def test_one_undetermined_person_among_many_changes_little() -> None:
    x = np.random.default_rng(1).normal(100, 20, 9)
    known = [gaussian(v, 4.0) for v in x]
    alone, joined = (Population(p, 0.95).mean() for p in (known, [*known, box(0, 500)]))
    assert joined.low_from == joined.high_from == "data"
    np.testing.assert_allclose(joined[:3], alone[:3], atol=2.0)


def test_a_person_adds_the_integral_over_the_own_value_when_gaussian() -> None:
    """The maximum with its normalisation against the integral, by quadrature."""
    p = Population([gaussian(1.0, 0.5), gaussian(2.0, 0.7)], 0.95)
    for t in (20, 40, 60):
        for g in (p.mu.size // 3, p.mu.size // 2):
            tau, mu = p.tau[t], p.mu[g]

            def both(x: float, mu: float = mu, tau: float = tau) -> float:
                return float(np.exp(-((x - 1) ** 2) / 0.5) * stats.norm.pdf(x, mu, tau))

            exact, _ = integrate.quad(both, -9, 11, points=[1, mu])
            assert p.marginal[0][t, g] == pytest.approx(np.log(exact), abs=0.02)


def test_values_of_people_are_drawn_to_the_mean_and_hold_the_truth() -> None:
    rng, held = np.random.default_rng(5), []
    for _ in range(20):
        truth = rng.normal(100, 10, 8)
        error = rng.uniform(5, 20, 8)
        seen = truth + error * rng.standard_normal(8)
        found = Population([gaussian(v, s) for v, s in zip(seen, error, strict=True)], 0.95)
        values = found.individual()
        mean = found.mean().value
        assert (np.abs([v.value - mean for v in values]) <= np.abs(seen - mean) + 3).all()
        held += [v.low <= x <= v.high for v, x in zip(values, truth, strict=True)]
    assert np.mean(held) > 0.9  # 160 intervals of 95 %


def test_two_people_have_no_values_drawn_to_the_mean() -> None:
    assert Population([gaussian(v, 1.0) for v in (3.0, 4.0)], 0.95).individual() == []


def test_equal_people_have_no_spread() -> None:
    found = Population([gaussian(v, 1.0) for v in (9.9, 10.0, 10.1, 10.0)], 0.95).between()
    assert found.value == 0
    assert found.low == 0
    assert found.low_from == "bound"


def test_the_hull_of_a_gaussian_profile_is_the_profile() -> None:
    value = np.array([-3.0, -1.0, 0.0, 0.5, 4.0])
    found = hull(value, np.abs(value), 0.0)
    np.testing.assert_array_equal(found[0], value[[0, 1, 2, 3, 4]])
    np.testing.assert_array_equal(found[1], np.abs(value))


def test_a_point_of_a_farther_valley_does_not_make_a_value_unlikely() -> None:
    value, root = hull(np.array([-2.0, -1.0, 0.0, 2.0]), np.array([1.0, 1.9, 0.0, 2.0]), 0.0)
    np.testing.assert_array_equal(value, [-2, 0, 2])
    np.testing.assert_array_equal(root, [1, 0, 2])


def test_limits_end_a_likelihood() -> None:
    p = Likelihood(np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.0, 1.0]), 2.0, limits=(0.0, 10.0))
    assert p.support == (0.0, 8.0)
    assert p.log(np.array([-0.1]))[0] == -np.inf


def test_the_spread_of_ten_normal_people_is_covered_nearly_as_theory_says() -> None:
    """Measured without error: 94.5 % with the chi-squared threshold, 96.1 with the one of Student's t (exact laws)."""
    example = module("group_coverage")
    drawn = np.random.default_rng(0).standard_normal(500)
    people = [example.Person({"x": v}, {"x": gaussian(v, 1e-3)}) for v in drawn]
    found = example.causes(people, "x", 10, 1000)
    assert found[0].chi_squared == pytest.approx(94.5, abs=2.2)  # three standard errors
    assert found[0].present == pytest.approx(96.1, abs=1.9)
    assert found[-1].present > found[-1].chi_squared


def test_a_person_of_the_example_goes_from_process_to_process() -> None:
    example = module("group_coverage")
    once = example.Person({"x": 1.0}, {"x": gaussian(1.0, 0.1)})
    assert pickle.loads(pickle.dumps(once)).truth == {"x": 1.0}


def test_changes_of_people_measured_twice_are_judged_against_their_mean() -> None:
    example, rng = module("group_coverage"), np.random.default_rng(2)
    true = rng.normal(0.0, 0.3, 64)
    people = [example.Person({}, {}, {"x": t}, {"x": gaussian(t + rng.normal(0.0, 0.5), 0.6)}) for t in true]
    found = np.mean(example.changes(people, "x", 60, 8), axis=0)
    assert found[0] >= 0.85
    assert found[1] <= 0.17
    assert found[2] <= 0.17


def test_the_interval_of_the_spread_ends_at_the_threshold_of_the_mean() -> None:
    found = Population([gaussian(v, 1e-2) for v in np.random.default_rng(1).standard_normal(10)], 0.95)
    root = np.interp([found.between().low, found.between().high], found.tau, np.sqrt(-2 * found.restricted))
    np.testing.assert_allclose(root**2, 10 * np.log1p(2.2622**2 / 9), rtol=1e-3)
