"""The compiled fits take one to four rows, and any outputs that are linear in the angles and the stimulus."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linked_segments import model

from mcstudy.errors import ModelError
from mcstudy.fitting.arguments import Prior
from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.lm import normal_equations
from mcstudy.fitting.outermost_kernel import DATA
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Problem, ml_cost, paper_cost
from mcstudy.fitting.solvers import Options, fit
from mcstudy.fitting.starts import uniform
from mcstudy.stance.feedback import Filter, Model, Output, OutputTerm, Parameter, Term
from mcstudy.stance.response import frf

F = np.array([1, 3, 5, 8, 10, 12, 14, 16, 18, 19, 21, 23, 24, 28, 35, 44, 56, 71, 88, 107, 133, 165, 201, 235]) / 43.72
WIDE = np.append(F, np.array([259, 280, 310, 350]) / 43.72)
"""The frequencies of the paper's figures, Hz."""

CENTRE = Output("centre of mass", (OutputTerm("ankle"), OutputTerm("knee", 0.22)))
RATE = Output("rate", (OutputTerm("knee", order=1),), "rad/s")
TORQUE = Output(
    "torque", (OutputTerm("ankle", 70.0, 2), OutputTerm("knee", -60.0), OutputTerm("stimulus", -1.0)), "N m"
)
SUM = Output("integral", (OutputTerm("ankle + knee", order=-1),), "rad s")
ANGLES = (Output("lower", (OutputTerm("ankle"),)), Output("upper", (OutputTerm("knee"),)))


def noisy(m: Model, noise: float = 0.1, seed: int = 0) -> Problem:
    """Maximum likelihood of responses whose errors are correlated between outputs."""
    rng = np.random.default_rng(seed)
    y = frf(m, m.truth, F)
    root = rng.normal(size=(*y.shape, y.shape[1])) + 1j * rng.normal(size=(*y.shape, y.shape[1]))
    root = noise * np.abs(y)[:, :, None] * (root + 2 * np.eye(y.shape[1])) / 2
    errors = (rng.normal(size=y.shape) + 1j * rng.normal(size=y.shape)) / np.sqrt(2)
    return ml_cost(m, F, y + np.einsum("nij,nj->ni", root, errors), root @ np.conj(np.swapaxes(root, 1, 2)))


def lagging(m: Model) -> Model:
    """The same, whose highest angle is measured late."""
    lag, tau = Filter("lag", "1", "1 + tau*s"), Parameter("tau", "s", 0.03, 0.0, 0.1)
    filters = (*(None for _ in m.angles[1:]), "lag")
    return replace(m, parameters=(*m.parameters, tau), filters=(lag,), output_filters=filters)


def torque_feedback() -> Model:
    """One joint under tilt, whose delayed torque is an unknown of its own that is fed back; only sway is measured.

    Peterka 2018: (J s^2 - m g h) sway = T, T = (Kp + Kd s) e^(-tau s) (W tilt - sway + Kt T / s).
    """
    values = {"Kp": 1019.25, "Kd": 354.85, "tau": 0.151, "Kt": 1.38e-4, "W": 0.534}
    terms = [Term("body", "sway", order=2, coefficient=90.0), Term("body", "sway", coefficient=-755.0)]
    terms += [Term("body", "torque", coefficient=-1.0), Term("muscle", "torque")]
    for gain, order in (("Kp", 0), ("Kd", 1)):
        terms.append(Term("muscle", "sway", gain, order, "tau", noisy=True))
        terms.append(Term("muscle", "torque", (gain, "Kt"), order - 1, "tau", coefficient=-1.0))
        terms.append(Term("muscle", "stimulus", (gain, "W"), order, "tau"))
    parameters = tuple(Parameter(k, "", v, 0.0, 2.0 * v) for k, v in values.items())
    angles, sway = ("sway", "torque"), Output("sway", (OutputTerm("sway"),))
    return Model("torque feedback", parameters, tuple(terms), rows=("muscle", "body"), angles=angles, outputs=(sway,))


CASES = {
    "one joint": model(1),
    "two joints": model(2),
    "three joints": model(3),
    "four joints": model(4),
    "three joints, one late": lagging(model(3)),
    "one output of two joints": model(2, (CENTRE,)),
    "a torque of three joints": model(3, (TORQUE,)),
    "three outputs of two joints": lagging(model(2, (CENTRE, RATE, TORQUE))),
    "four outputs of three joints": model(3, (CENTRE, RATE, TORQUE, SUM)),
    "outputs that say the same twice": model(2, (CENTRE, replace(CENTRE, name="again"), SUM)),
    "one output of four joints": model(4, (SUM,)),
    "torque feedback": torque_feedback(),
}


@pytest.mark.parametrize("case", CASES)
def test_cost_gradient_and_gram_matrix_equal_the_closed_form(case: str) -> None:
    m = CASES[case]
    data = noisy(m)
    for problem in (data, paper_cost(m, F, data.y)):
        theta = uniform(m, np.random.default_rng(5), 9)
        for x, cost, gradient, gram in zip(theta, *normal_equations(problem, theta), strict=True):
            r, J = problem.residual(x), problem.jacobian(x)
            size = np.linalg.norm(J, axis=0)
            assert cost == pytest.approx(r @ r, rel=1e-11)
            np.testing.assert_allclose(gradient / size, J.T @ r / size, rtol=1e-8, atol=1e-10 * np.linalg.norm(r))
            np.testing.assert_allclose(gram / np.outer(size, size), J.T @ J / np.outer(size, size), atol=1e-9)


def analytic_cost(problem: Problem, x: np.ndarray) -> complex:
    """The cost as an analytic function of the parameters, without a complex conjugate of them."""
    m, f, y, weight = problem.model, problem.f, problem.y, problem.weight
    r = np.einsum("nij,nj->ni", weight, frf(m, x, f) - y)
    mirrored = np.einsum("nij,nj->ni", weight.conj(), frf(m, x, -f) - y.conj())
    return complex((r * mirrored).sum())


@pytest.mark.parametrize("case", CASES)
def test_gradients_are_those_of_complex_steps(case: str) -> None:
    """By Cauchy's formula on a circle of eight complex steps."""
    problem = noisy(CASES[case])
    x = uniform(problem.model, np.random.default_rng(7), 1)[0]
    cost, gradient, gram = normal_equations(problem, x[None])
    size = np.sqrt(np.einsum("pp->p", gram[0]) * cost[0])
    turns = np.exp(2j * np.pi * np.arange(8) / 8)
    for p, unit in enumerate(np.diag(1e-4 * np.abs(problem.model.truth))):
        slope = np.mean([analytic_cost(problem, x + turn * unit) / turn for turn in turns]) / unit[p]
        assert 2 * gradient[0, p] == pytest.approx(slope.real, rel=1e-8, abs=1e-8 * size[p])


@pytest.mark.parametrize("case", ["three joints", "three outputs of two joints", "four outputs of three joints"])
def test_solvers_reach_the_same_minimum(case: str) -> None:
    problem = noisy(CASES[case], 0.01)
    start = problem.model.truth[None]
    fits = {s: fit(problem, start, s, Options(1e-12, 1000)) for s in ("lm", "trf", "trust-constr")}
    x = fits["lm"].estimate[0]
    assert fits["lm"].cost[0] == pytest.approx(problem.cost(x), rel=1e-10)
    assert fits["lm"].cost[0] == pytest.approx(fits["trf"].cost[0], rel=1e-7)
    assert fits["lm"].cost[0] == pytest.approx(fits["trust-constr"].cost[0], rel=1e-3)


def test_declared_angles_are_fitted_as_the_angles_themselves() -> None:
    plain, declared = model(2), model(2, ANGLES)
    given = noisy(plain)
    other = Problem(given.f, given.y, given.weight, declared)
    starts = uniform(plain, np.random.default_rng(0), 8)
    np.testing.assert_allclose(fit(other, starts).cost, fit(given, starts).cost, rtol=1e-9)


def test_ends_of_intervals_lie_where_the_deviance_of_all_outputs_reaches_its_ceiling() -> None:
    m = model(2, (CENTRE, RATE, TORQUE))
    data = noisy(m, 1e-4)
    data = replace(data, weight=np.sqrt(2) * data.weight)
    P = m.truth.size
    fitter = Fitter(m, Prior(m.truth, m.upper - m.lower, 0.0), F)
    best = fitter.pick(fitter.fits(fitter.packed(data), m.truth, tolerance=1e-10))
    assert best.chi2 == pytest.approx(data.cost(best.theta), rel=1e-9)
    height = np.full(2 * P, 0.01)
    outwards = np.concatenate([np.eye(P), -np.eye(P)])
    ends = fitter.ends(fitter.packed(data), np.tile(best.theta, (2 * P, 1)), outwards, best.chi2 + height, height)
    assert (ends.status == DATA).all()
    for x, chi2 in zip(ends.estimate, ends.chi2, strict=True):
        assert data.cost(x) - best.chi2 == pytest.approx(0.01, rel=1e-4)
        assert chi2 == pytest.approx(data.cost(x), rel=1e-9)


def bounded(m: Model) -> Model:
    """Three segments with bounds of zero and twice the truth, and 30 ms about the delays."""

    def wide(p: Parameter) -> Parameter:
        if p.name.startswith("Td"):
            return replace(p, lower=p.value - 0.03, upper=p.value + 0.03)
        return replace(p, lower=0.0, upper=2 * p.value)

    return replace(m, parameters=tuple(map(wide, m.parameters)))


def test_one_stimulus_identifies_all_24_parameters_of_three_segments_without_noise() -> None:
    m = bounded(model(3))
    problem = paper_cost(m, WIDE, frf(m, m.truth, WIDE))
    fits = fit(problem, uniform(m, np.random.default_rng(0), 40))
    identified = (np.abs(fits.estimate / m.truth - 1) < 1e-3).all(axis=1)
    assert 20 <= identified.sum() < 40  # 34 by another solver


def test_the_sway_alone_identifies_torque_that_is_fed_back() -> None:
    m = torque_feedback()
    problem = paper_cost(m, F, frf(m, m.truth, F))
    fits = fit(problem, uniform(m, np.random.default_rng(0), 20))
    np.testing.assert_allclose(fits.estimate[fits.best], m.truth, rtol=1e-6)


def test_the_lowest_cost_of_a_noisy_problem_is_its_degrees_of_freedom() -> None:
    m = bounded(model(3))
    problem = noisy(m, 0.02)
    fits = fit(problem, uniform(m, np.random.default_rng(0), 60))
    freedom = 2 * problem.y.size - m.truth.size
    assert 2 * fits.cost.min() / freedom == pytest.approx(1.0, abs=4 * np.sqrt(2 / freedom))


@pytest.mark.parametrize("outputs", [(), (CENTRE, RATE, Output("hip", (OutputTerm("hip"),)), TORQUE)])
def test_a_linearised_start_of_three_segments_leads_to_the_truth_without_noise(outputs: tuple[Output, ...]) -> None:
    m = bounded(model(3, outputs))
    problem = paper_cost(m, WIDE, frf(m, m.truth, WIDE))
    start = linearised(problem, np.random.default_rng(0), 1)
    assert problem.cost(start[0]) < 1e-4
    np.testing.assert_allclose(fit(problem, start).estimate[0], m.truth, rtol=1e-5)


def test_linearised_starts_need_outputs_that_tell_every_angle() -> None:
    m = model(3, (CENTRE, RATE))
    with pytest.raises(ModelError, match="linearised starts need outputs that tell all of ankle, knee, hip"):
        linearised(noisy(m), np.random.default_rng(0), 1)
