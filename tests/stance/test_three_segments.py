"""Models of three joints and four, and declared outputs, against matrices that numpy makes without the table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linked_segments import JOINTS, matrices, model

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Output, OutputTerm
from mcstudy.stance.joint import joined, members
from mcstudy.stance.response import frf, frf_jacobian, noise_response

F = np.array([1, 9, 27, 53, 151, 351]) / 43.72
PUBLISHED = np.array(
    [
        [5.358047939e-03 - 6.517584667e-05j, -2.480638195e-03 - 1.123622857e-04j, -5.783628590e-03 + 5.892538777e-05j],
        [5.678679766e-03 - 8.119126806e-04j, -3.088420016e-03 - 8.824024851e-04j, -6.379073021e-03 + 8.752717260e-04j],
        [3.954798092e-03 - 4.343974415e-03j, -5.144514649e-03 + 1.634921585e-03j, -4.640746444e-03 + 6.172142588e-03j],
        [4.157249405e-04 - 3.622800939e-03j, -1.530725559e-03 + 2.868939068e-03j, 4.813680857e-04 + 6.285966974e-03j],
        [2.553266317e-03 - 4.201674459e-06j, -6.446546077e-03 + 3.847432343e-03j, 5.107649170e-03 - 8.263746509e-03j],
        [-6.064073272e-04 - 3.894005436e-04j, 1.199878440e-03 + 7.586218508e-04j, -5.500023401e-04 - 3.267187159e-04j],
    ]
)
"""Responses of the three angles to a torque at the ankle, rad/(N m), computed by another program."""


def test_three_segments_respond_as_another_program_computed() -> None:
    m = model(3)
    assert (m.n_rows, m.rows, m.output_names) == (3, ("hip", "knee", "ankle"), ("ankle", "knee", "hip"))
    assert m.table.weight.shape == (len(m.terms), 5)
    np.testing.assert_allclose(frf(m, m.truth, F), PUBLISHED, rtol=2e-9)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_responses_are_those_of_the_matrices(n: int) -> None:
    m = model(n)
    A, active = matrices(n, F)
    np.testing.assert_allclose(frf(m, m.truth, F), np.linalg.inv(A)[:, :, 0], rtol=1e-9)
    # sources are the sensed angles, in their order
    np.testing.assert_allclose(noise_response(m, m.truth, F), -np.linalg.solve(A, active), rtol=1e-9)


OUTPUTS = (
    Output("centre of mass", (OutputTerm("ankle"), OutputTerm("hip", 0.2)), "rad"),
    Output("trunk in space", (OutputTerm("ankle + hip"),), "rad"),
    Output("rate", (OutputTerm("hip", order=1),), "rad/s"),
    Output("torque", (OutputTerm("ankle", 70.0, 2), OutputTerm("ankle", -600.0), OutputTerm("stimulus", -1.0)), "N m"),
)


@pytest.mark.parametrize("n", [3, 4])
def test_outputs_are_sums_of_angles_their_derivatives_and_the_stimulus(n: int) -> None:
    plain, m = model(n), model(n, OUTPUTS)
    assert (m.n_outputs, m.output_names[0], m.output_units) == (4, "centre of mass", ("rad", "rad", "rad/s", "N m"))
    s, ankle, hip = 2j * np.pi * F, 0, 2

    def outputs(x: np.ndarray) -> np.ndarray:
        """Of angles (N, n, ...), without the stimulus."""
        rate = s.reshape(-1, *(1 for _ in x.shape[2:]))
        a, h = x[:, ankle], x[:, hip]
        return np.stack([a + 0.2 * h, a + h, rate * h, (70 * rate**2 - 600) * a], axis=1)

    H, dH = frf_jacobian(plain, plain.truth, F)
    found, slopes = frf_jacobian(m, m.truth, F)
    np.testing.assert_allclose(slopes, outputs(dH), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found, outputs(H) - [0, 0, 0, 1], rtol=1e-9)
    np.testing.assert_array_equal(frf(m, np.stack([m.truth] * 2), F), [frf(m, m.truth, F)] * 2)
    np.testing.assert_allclose(found, frf(m, m.truth, F), rtol=1e-9)
    noise = noise_response(plain, plain.truth, F)
    np.testing.assert_allclose(noise_response(m, m.truth, F), outputs(noise), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_derivatives_are_exact(n: int) -> None:
    m = model(n, tuple(replace(o, terms=tuple(t for t in o.terms if t.sense in JOINTS[:n])) for o in OUTPUTS))
    slopes = frf_jacobian(m, m.truth, F)[1]
    for p in range(len(m.parameters)):
        # the mean over a circle (Cauchy's formula) is exact for an analytic function, here to 1e-10
        turn = np.exp(2j * np.pi * np.arange(8) / 8)
        r = 1e-3 * max(1e-2, abs(m.truth[p]))
        at = m.truth + np.outer(turn, np.arange(len(m.parameters)) == p) * r
        mean = np.einsum("k,kny->ny", turn.conj(), frf(m, at, F)) / (8 * r)
        np.testing.assert_allclose(slopes[..., p], mean, rtol=1e-8, atol=1e-9 * np.abs(mean).max())


def test_stimuli_of_several_joints_are_fitted_together() -> None:
    """Each line has the response to its own stimulus, and an output holds what it holds of that stimulus."""
    each = [model(3, OUTPUTS), model(3, (*OUTPUTS[:3], replace(OUTPUTS[3], terms=OUTPUTS[3].terms[:2])), "hip")]
    both = joined(each, [len(F), len(F)])
    expected = np.concatenate([frf(m, m.truth, F) for m in each])
    np.testing.assert_allclose(frf(both, both.truth, np.tile(F, 2)), expected, rtol=1e-12)
    np.testing.assert_allclose(frf_jacobian(both, both.truth, np.tile(F, 2))[0], expected, rtol=1e-9)
    assert members(both) == tuple(each)


def test_a_model_says_in_one_line_what_is_wrong_with_its_outputs() -> None:
    for outputs, message in (
        ((Output("a", (OutputTerm("elbow"),)),), "output a: sense must be one of"),
        ((Output("a", (OutputTerm("hip", order=3),)),), "order must be -1, 0, 1 or 2, got 3"),
        ((Output("a", (OutputTerm("hip", np.nan),)),), "output a: expected a finite coefficient"),
        ((Output("a", (OutputTerm("hip"),)),) * 2, "output a is declared twice"),
    ):
        with pytest.raises(ModelError, match=message):
            model(3, outputs)
