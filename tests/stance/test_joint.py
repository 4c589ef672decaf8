"""One model of several stimuli: the responses, derivatives and fits of each, one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.effect_library.library import LIBRARY, apply
from mcstudy.errors import ModelError
from mcstudy.fitting.lm import normal_equations
from mcstudy.fitting.problem import Problem
from mcstudy.stance.body import STIMULI, Body, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import changed, joined, members, with_lines
from mcstudy.stance.response import frf, frf_jacobian

KINDS = ("ankle_torque", "platform_translation", "surface_tilt", "hip_torque")
F = (np.array([0.1, 0.7, 2.0]), np.array([0.2, 1.1]), np.array([0.05, 0.3, 0.9, 1.5]), np.array([0.4]))
LINES = tuple(len(f) for f in F)


def joint(kinds: tuple[str, ...] = KINDS) -> Model:
    return joined([two_segment(stimulus=k) for k in kinds], [LINES[KINDS.index(k)] for k in kinds])


def test_responses_and_derivatives_are_those_of_the_single_stimuli() -> None:
    model = joint()
    H, J = frf_jacobian(model, model.truth, np.concatenate(F))
    np.testing.assert_allclose(H, frf(model, model.truth, np.concatenate(F)), rtol=1e-12)
    at = 0
    for kind, f in zip(KINDS, F, strict=True):
        one = two_segment(stimulus=kind)
        of = [model.names.index(n) for n in one.names]
        H1, J1 = frf_jacobian(one, one.truth, f)
        np.testing.assert_allclose(H[at : at + f.size], H1, rtol=1e-12)
        np.testing.assert_allclose(J[at : at + f.size][..., of], J1, rtol=1e-10)
        rest = np.delete(J[at : at + f.size], of, axis=-1)
        assert not rest.any()  # the sensory weight of a tilt moves nothing under a torque
        at += f.size


def test_parameters_are_those_of_all_stimuli_once() -> None:
    assert joint().names == (*two_segment().names, "Wprop")
    assert [m.stimulus_unit for m in members(joint())] == [STIMULI[k] for k in KINDS]


@pytest.mark.parametrize("effect", [None, *(e.name for e in LIBRARY.values() if e.kind == "linear")])
def test_an_effect_of_a_joint_model_is_that_effect_under_every_stimulus(effect: str | None) -> None:
    model = joint() if effect is None else apply(joint(), effect)
    theta = np.where(model.truth == 0, 0.01, 1.01 * model.truth)
    f = [F[KINDS.index(k)] for k in KINDS]
    H = np.split(frf(model, theta, np.concatenate(f)), np.cumsum([x.size for x in f])[:-1])
    for one, kind, own in zip(members(model), KINDS, H, strict=True):
        alone = two_segment(stimulus=kind) if effect is None else apply(two_segment(stimulus=kind), effect)
        of = [model.names.index(n) for n in alone.names]
        np.testing.assert_allclose(own, frf(alone, theta[of], F[KINDS.index(kind)]), rtol=1e-10)
        np.testing.assert_allclose(own, frf(one, theta, F[KINDS.index(kind)]), rtol=1e-10)


@pytest.mark.parametrize("effect", [None, "stimulus_gain", "stimulus_lag", "stimulus_delay", "trunk_inertia_error"])
def test_the_compiled_fits_see_the_stimulus_of_every_line(effect: str | None) -> None:
    """Gram matrix and gradient of the kernel against the closed form, for terms with and without parameters."""
    model = joint() if effect is None else apply(joint(), effect)
    rng, n = np.random.default_rng(1), sum(LINES)
    theta = np.where(model.truth == 0, 0.01, 1.02 * model.truth)
    weight = np.tril(rng.standard_normal((n, 2, 2)) + 1j * rng.standard_normal((n, 2, 2)))
    weight[:, [0, 1], [0, 1]] = np.abs(weight[:, [0, 1], [0, 1]]) + 1
    data = frf(model, theta, np.concatenate(F)) * (1 + 0.1 * rng.standard_normal((n, 2)))
    problem = Problem(np.concatenate(F), data, 1e3 * weight, model)
    cost, gradient, gram = normal_equations(problem, theta[None])
    r, J = problem.residual(theta), problem.jacobian(theta)
    np.testing.assert_allclose(cost[0], r @ r, rtol=1e-10)
    np.testing.assert_allclose(gradient[0], J.T @ r, rtol=1e-8, atol=1e-12 * np.abs(J.T @ r).max())
    np.testing.assert_allclose(gram[0], J.T @ J, rtol=1e-8, atol=1e-12 * np.abs(J.T @ J).max())


def test_other_numbers_of_lines_are_refused_and_may_be_stated() -> None:
    model = joint(("ankle_torque", "hip_torque"))
    with pytest.raises(ModelError, match="expected the 4 lines of its stimuli, got 5 frequencies"):
        frf(model, model.truth, np.linspace(0.1, 1, 5))
    frf(with_lines(model, (2, 3)), model.truth, np.linspace(0.1, 1, 5))
    assert with_lines(two_segment(), (5,)) is not None


def test_models_of_different_bodies_are_refused() -> None:
    other = two_segment(Body(A2=14.0), "hip_torque")
    with pytest.raises(ModelError, match="expected the same body and feedback under every stimulus"):
        joined([two_segment(), other], (1, 1))
    with pytest.raises(ModelError, match="expected the same K11 under every stimulus"):
        joined([two_segment(), two_segment(stimulus="hip_torque").with_values({"K11": 900.0})], (1, 1))


def test_a_change_is_made_under_every_stimulus() -> None:
    assert changed(joint(), lambda m: m) == joint()
