"""The rightmost root is right, is proved right, and means what a simulation does."""

import numpy as np
import pytest

from mcstudy.errors import ModelError
from mcstudy.stance.body import Body, one_segment, two_segment
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.response import system
from mcstudy.stance.simulate_time import simulate
from mcstudy.stance.stability import Proof, growth_rate, rightmost_root, roots_chebyshev

MODEL = two_segment()
ONE = Monomial(1.0, 0)


def between_bounds(model, n, seed):
    rng = np.random.default_rng(seed)
    return model.lower + (model.upper - model.lower) * rng.random((n, len(model.names)))


def lag(name, time_constant):
    return Filter(name, (ONE,), (ONE, Monomial(1.0, 1, ((time_constant, 1),))))


def filtered(which, filt, parameters, base=MODEL):
    terms = tuple(
        Term(t.row, t.sense, t.gain, t.order, t.delay, (filt.name,), t.coefficient, t.noisy) if which(t) else t
        for t in base.terms
    )
    return Model(filt.name, (*base.parameters, *parameters), terms, (filt,))


ACTIVATION = filtered(
    lambda t: t.noisy,
    Filter(
        "activation",
        (Monomial(1.0, 0, (("omega", 2),)),),
        (Monomial(1.0, 2), Monomial(2.2, 1, (("omega", 1),)), Monomial(1.0, 0, (("omega", 2),))),
    ),
    [Parameter("omega", "rad/s", 30.0, 10.0, 100.0)],
)
FORCE_FEEDBACK = filtered(
    lambda t: t.noisy and t.row == "ankle",
    Filter(
        "force",
        (Monomial(16.5, 1), ONE),
        (Monomial(16.5, 1), ONE, Monomial(-1.0, 0, (("G", 1),))),
    ),
    [Parameter("G", "", 1.5, 0.0, 4.0)],
)
INTEGRAL = MODEL.with_terms(
    parameters=[Parameter("Ki", "N m/(rad s)", 100.0, 0.0, 300.0)],
    terms=[Term("ankle", "theta1", ("Ki",), -1, "Td1", noisy=True)],
)
ACCELERATION = MODEL.with_terms(
    parameters=[Parameter("Ka", "N m s^2/rad", 8.0, -16.0, 16.0)],
    terms=[Term("ankle", "theta1", ("Ka",), 2, "Td1", noisy=True)],
)
MODELS = {
    "two_segment": MODEL,
    "one_segment": one_segment(),
    "activation": ACTIVATION,
    "force_feedback": FORCE_FEEDBACK,
    "integral": INTEGRAL,
    "acceleration": ACCELERATION,
}


def test_the_standing_truth_is_stable_with_the_known_root():
    found = rightmost_root(MODEL, MODEL.truth)
    assert complex(found.root) == pytest.approx(-1.2349282 + 16.0758944j, abs=1e-6)
    assert found.proof == Proof.SEARCH


@pytest.mark.parametrize(("name", "count"), [(n, 120 if n == "two_segment" else 40) for n in MODELS])
def test_search_agrees_with_the_chebyshev_discretisation(name, count):
    model = MODELS[name]
    theta = between_bounds(model, count, 1)
    growth = growth_rate(model, theta)
    reference = np.array([roots_chebyshev(model, t, 26)[0].real for t in theta])
    assert growth == pytest.approx(reference, abs=1e-8)


@pytest.mark.parametrize("name", MODELS)
def test_every_answer_is_a_root_and_nearly_all_are_proved_by_the_search(name):
    model = MODELS[name]
    theta = between_bounds(model, 2000, 2)
    found = rightmost_root(model, theta)
    searched = np.isin(found.proof, (Proof.SEARCH, Proof.RESTART))
    assert searched.mean() > 0.99
    assert not (found.proof >= Proof.UNCERTAIN).any()
    for t, root in zip(theta[searched][:100], found.root[searched][:100], strict=True):
        determinant, nearby = (np.linalg.det(system(model, t, np.array([s]))[0][0]) for s in (root, root + 1e-3))
        assert abs(determinant) < 1e-7 * abs(nearby)


def test_growth_does_not_depend_on_the_batch():
    theta = between_bounds(MODEL, 60, 3)
    batched = growth_rate(MODEL, theta.reshape(3, 20, -1))
    assert batched.shape == (3, 20)
    assert np.array_equal(batched.ravel(), [growth_rate(MODEL, t) for t in theta])


def test_a_failed_fit_has_no_growth_rate():
    theta = np.stack([MODEL.truth, np.full(12, np.nan)])
    found = rightmost_root(MODEL, theta)
    assert np.isnan(found.root[1])
    assert found.proof[1] == Proof.NONE
    assert found.root[0] == rightmost_root(MODEL, MODEL.truth).root


def test_without_delay_a_pendulum_has_the_roots_of_its_quadratic():
    body = Body()
    for K, B, Kpas in ((1057.0, 372.0, 146.0), (1057.0, 40.0, 146.0), (300.0, 50.0, 100.0)):
        expected = np.roots([body.J1 + body.C2, B, K + Kpas - body.mgh])
        assert growth_rate(one_segment(), np.array([K, B, Kpas, 0.0])) == pytest.approx(expected.real.max(), abs=1e-10)


@pytest.mark.parametrize(("omega", "delay"), [(3.0, 0.1), (6.0, 0.08), (9.0, 0.12)])
def test_a_loop_tuned_to_the_edge_has_zero_growth(omega, delay):
    """K and B that put s = i omega on a root: (K + i B omega) = -(rest) exp(i omega delay)."""
    body = Body()
    target = ((body.J1 + body.C2) * omega**2 + body.mgh) * np.exp(1j * omega * delay)
    found = rightmost_root(one_segment(), np.array([target.real, target.imag / omega, 0.0, delay]))
    assert complex(found.root) == pytest.approx(1j * omega, abs=1e-10)


@pytest.mark.parametrize("delays", [(0.08, 0.092), (0.11, 0.092), (0.08, 0.145), (0.05, 0.06)])
def test_growth_is_what_a_simulation_does(delays):
    """A push dies out or grows at the rate of the rightmost root."""
    theta = MODEL.truth.copy()
    theta[-2:] = delays
    root = complex(rightmost_root(MODEL, theta).root)
    n, rate = 4000, 200.0
    push = np.zeros(n)
    push[1:20] = 1.0
    sway = simulate(MODEL, theta, push, rate).angle[:, 0]
    windows = sway[1000:3000].reshape(4, 500)
    power = np.log(np.square(windows).sum(axis=1)) / 2
    slope = np.polyfit(np.arange(4) * 500 / rate, power, 1)[0]
    assert np.sign(slope) == np.sign(root.real)
    assert slope == pytest.approx(root.real, rel=0.1, abs=0.05)


def test_an_unstable_filter_that_the_loop_stabilises_is_stable():
    """Force feedback of gain above one is a runaway by itself; in the loop it lifts the stiffness at low frequency."""
    theta = FORCE_FEEDBACK.truth
    assert (FORCE_FEEDBACK.truth[-1] - 1) / 16.5 > 0
    assert growth_rate(FORCE_FEEDBACK, theta) < 0


def test_an_unstable_filter_with_no_feedback_through_it_is_unstable():
    theta = FORCE_FEEDBACK.truth.copy()
    names = FORCE_FEEDBACK.names
    for name in ("K11", "B11", "K21", "B21"):
        theta[names.index(name)] = 0.0
    theta[names.index("Kpas1")] = 2000.0
    theta[names.index("G")] = 4.0
    assert growth_rate(FORCE_FEEDBACK, theta) >= 3.0 / 16.5 - 1e-12


def test_an_integral_without_gain_is_not_a_root_at_zero():
    theta = np.append(MODEL.truth, 0.0)
    assert growth_rate(INTEGRAL, theta) == pytest.approx(growth_rate(MODEL, MODEL.truth), abs=1e-12)
    assert growth_rate(INTEGRAL, np.append(MODEL.truth, 1e-3)) == pytest.approx(0.0, abs=1e-4)


def test_filters_outside_the_loop_do_not_count():
    base = two_segment()
    slow = Parameter("tau", "s", 5.0, 1.0, 10.0)
    model = filtered(lambda t: t.sense == "stimulus", lag("slow", "tau"), [slow], base)
    measured = Model("measured", (*base.parameters, slow), base.terms, (lag("slow", "tau"),), ("slow", "slow"))
    for m in (model, measured):
        assert growth_rate(m, m.truth) == pytest.approx(growth_rate(base, base.truth), abs=1e-12)
        assert roots_chebyshev(m, m.truth, 26)[0].real == pytest.approx(growth_rate(m, m.truth), abs=1e-8)


def test_a_nearly_instant_filter_changes_nothing():
    tiny = Parameter("tau", "s", 1e-7, 0.0, 1.0)
    model = filtered(lambda t: t.noisy, lag("tiny", "tau"), [tiny])
    for tau in (0.0, 1e-9, 1e-7):
        theta = np.append(MODEL.truth, tau)
        found = rightmost_root(model, theta)
        assert found.root.real == pytest.approx(growth_rate(MODEL, MODEL.truth), abs=1e-3)
        assert found.proof in (Proof.SEARCH, Proof.RESTART)


def test_delayed_acceleration_beyond_the_inertia_is_unstable_at_the_rate_of_its_chain():
    """J + Ka exp(-s T) = 0 has infinitely many roots with Re s -> ln(Ka / J) / T."""
    body = Body()
    inertia = body.J1 + body.C2
    model = one_segment().with_terms(
        parameters=[Parameter("Ka", "N m s^2/rad", 89.0, 0.0, 200.0)],
        terms=[Term("ankle", "theta1", ("Ka",), 2, "Td", noisy=True)],
    )
    chain = np.log(89.0 / inertia) / 0.08
    found = rightmost_root(model, model.truth)
    assert found.root.real >= chain - 1e-9
    assert found.root.real == pytest.approx(chain, abs=0.2)
    assert found.proof in (Proof.SEARCH, Proof.RESTART, Proof.CHAIN)
    weak = model.truth.copy()
    weak[-1] = 20.0
    assert growth_rate(model, weak) == pytest.approx(roots_chebyshev(model, weak, 40)[0].real, abs=1e-8)


def test_wrong_input_is_named():
    with pytest.raises(ModelError, match="expected 12 parameters"):
        growth_rate(MODEL, np.zeros(11))
    theta = MODEL.truth.copy()
    theta[-1] = -0.01
    with pytest.raises(ModelError, match="delay Td2 is negative"):
        growth_rate(MODEL, theta)


def loop(*terms, delay=0.0):
    """One unknown, the sum of terms that each have the gain ``a`` to the first power, or none."""
    parameters = (Parameter("a", "", 1.0, -1e12, 1e12), Parameter("T", "s", delay, 0.0, 10.0))
    return Model("loop", parameters, tuple(Term("row", "x", *t) for t in terms), rows=("row",), angles=("x",))


@pytest.mark.parametrize("pole", [1e-7, 1e-2, 1.0, 300.0, 1e5, 1e10])
def test_a_loop_of_first_order_has_its_pole_however_fast(pole):
    found = rightmost_root(loop(("a",), ((), 1)), np.array([pole, 0.0]))
    assert complex(found.root) == pytest.approx(-pole, rel=1e-12)
    assert found.proof == Proof.SEARCH


def test_a_loop_without_dynamics_does_not_grow():
    found = rightmost_root(loop(("a",)), np.array([[2.0, 0.0], [0.0, 0.0]]))
    assert found.root[0].real == -np.inf
    assert found.proof.tolist() == [Proof.STATIC, Proof.NONE]  # the second one, 0 x = 0, is no loop
    assert np.isnan(found.root[1])


def test_a_delayed_term_of_higher_order_than_the_others_grows_without_bound():
    found = rightmost_root(loop(((),), ("a", 1, "T")), np.array([[0.3, 0.2], [0.3, 0.0]]))
    assert found.root[0].real == np.inf
    assert found.proof[0] == Proof.ADVANCED
    assert found.root[1] == pytest.approx(-1 / 0.3)  # without its delay it is a pole


@pytest.mark.parametrize("gain", [0.05, 0.9, 3.0])
def test_a_delayed_gain_without_dynamics_has_a_chain_of_roots(gain):
    """1 + a exp(-T s) = 0 has all its roots on Re s = ln(a) / T."""
    found = rightmost_root(loop(((),), ("a", 0, "T")), np.array([gain, 0.2]))
    assert found.root.real == pytest.approx(np.log(gain) / 0.2, abs=1e-9)
    assert found.proof == Proof.CHAIN
