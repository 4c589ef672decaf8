"""Linked segments: matrices against those of other programs, outputs against the statics of a chain."""

from __future__ import annotations

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import ModelError
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf, system

THREE = mc.LinkedBody(
    (6.789, 14.600, 49.494), (0.41328, 0.41160, 0.0), (0.23432976, 0.2333772, 0.30288384),
    (0.10575684, 0.25805283, 2.8504895),
)  # fmt: skip
JOINTS = ("ankle", "knee", "hip")
F = np.array([0.05, 0.5, 2.0])


def passive(body: mc.LinkedBody, joints: tuple[str, ...], stimulus: tuple[Term, ...], **kinds: object) -> Model:
    """The chain on springs and dampers, with all outputs."""
    springs = [Term(j, j, "K", coefficient=1000.0) for j in joints]
    dampers = [Term(j, j, order=1, coefficient=30.0) for j in joints]
    terms = (*body.terms(joints), *springs, *dampers, *stimulus)
    outputs = body.outputs(joints, **kinds)  # type: ignore[arg-type]
    return Model("chain", (Parameter("K", "", 1.0, 0.0, 2.0),), terms, angles=joints, outputs=outputs)


def test_three_segments_have_the_matrices_of_another_program() -> None:
    M = [[72.641310, 45.192635, 19.756721], [45.192635, 29.169782, 13.561269], [19.756721, 13.561269, 7.391001]]
    np.testing.assert_allclose(THREE.inertia_matrix, M, atol=6e-7)
    np.testing.assert_allclose(-np.diag(THREE.gravity_matrix), [655.7946, 380.3334, 147.0611], atol=6e-5)
    np.testing.assert_array_equal(THREE.gravity_matrix, THREE.gravity_matrix.T)
    np.testing.assert_allclose(THREE.platform * 9.81, [655.7946, 380.3334, 147.0611], atol=6e-5)


def test_two_segments_are_the_double_pendulum_and_the_two_segment_body() -> None:
    m1, h1, I1, m2, h2, I2, L1 = 26.0, 0.55, 1.4, 50.0, 0.32, 3.1, 0.9
    one = Body.from_segments(m1=m1, h1=h1, I1=I1, m2=m2, h2=h2, I2=I2, L1=L1)
    two = mc.LinkedBody((m1, m2), (L1, 0.0), (h1, h2), (I1, I2))
    trunk = I2 + m2 * h2**2  # about the hip; the rest by Steiner's theorem with the hip bent or not
    both = I1 + m1 * h1**2 + I2 + m2 * (L1 + h2) ** 2
    expected = [[both, trunk + m2 * L1 * h2], [trunk + m2 * L1 * h2, trunk]]
    np.testing.assert_allclose(two.inertia_matrix, expected, rtol=1e-15)
    np.testing.assert_allclose([[one.J1 + one.C2, one.C2], [one.C1 + one.J2, one.J2]], expected, rtol=1e-15)
    np.testing.assert_allclose(two.platform, [one.A1 + one.A2, one.A2], rtol=1e-15)
    plants = [Model("plant", (), terms, angles=angles) for terms, angles in (
        (one.terms(), ("theta1", "theta2")), (two.terms(("ankle", "hip")), ("ankle", "hip")))]  # fmt: skip
    of_body, of_chain = (system(plant, np.zeros(0), 2j * np.pi * F)[0] for plant in plants)
    np.testing.assert_allclose(of_chain, of_body, rtol=1e-15)
    weight = two.outputs(("ankle", "hip"))[1].terms[1].coefficient
    assert weight == pytest.approx(one.A2 / (one.A1 + one.A2))


@pytest.mark.parametrize("stimulus", ["torque", "platform"])
@pytest.mark.parametrize("ankle_height", [0.0, 0.07])
def test_outputs_are_the_statics_and_dynamics_of_the_chain(stimulus: str, ankle_height: float) -> None:
    platform = stimulus == "platform"
    drive = THREE.platform_terms(JOINTS) if platform else (Term("ankle", "stimulus"),)
    kinds = {"platform": platform, "torque_at": None if platform else "ankle", "ankle_height": ankle_height}
    m = passive(THREE, JOINTS, drive, **kinds)
    assert m.output_names == ("com", "com_angle", "cop", "torque_ankle", "torque_knee", "torque_hip")
    assert m.output_units == ("m", "rad", "m", "N m", "N m", "N m")
    angles = Model(m.name, m.parameters, m.terms, angles=JOINTS)
    q, s = frf(angles, angles.truth, F), 2j * np.pi * F
    com, com_angle, cop, *torques = frf(m, m.truth, F).T
    # torques are what springs and dampers give
    np.testing.assert_allclose(np.transpose(torques), -(1000.0 + 30.0 * s[:, None]) * q, rtol=1e-9)
    in_space = np.cumsum(q, axis=1)
    L, h, mass = np.array(THREE.length), np.array(THREE.height), np.array(THREE.mass)
    joint = np.concatenate([np.zeros((3, 1)), np.cumsum(in_space[:, :2] * L[:2], axis=1)], axis=1)
    expected = (joint + in_space * h) @ mass / mass.sum() + platform
    np.testing.assert_allclose(com, expected, rtol=1e-9)
    np.testing.assert_allclose(com_angle * THREE.centre_height, expected - platform, rtol=1e-9)
    force = mass.sum() * s**2 * expected
    np.testing.assert_allclose(cop, -(torques[0] + ankle_height * force) / (mass.sum() * 9.81), rtol=1e-9)


def test_what_is_no_body_is_refused_in_one_line() -> None:
    for mass, length, message in (
        ((1.0,), (1.0, 1.0), "length: expected as many numbers as segments"),
        ((0.0,), (1.0,), "mass: expected the numbers of bodies"),
        ((1.0,) * 5, (1.0,) * 5, "mass: expected as many numbers as segments, 1 to 4"),
    ):
        with pytest.raises(ModelError, match=message):
            mc.LinkedBody(mass, length, (0.5,) * len(mass), (0.1,) * len(mass))
    with pytest.raises(ModelError, match="expected 3 joints"):
        THREE.terms(("ankle", "hip"))
