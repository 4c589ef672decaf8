"""The closed form is the paper's equations, and its derivatives are exact."""

import mpmath as mp
import numpy as np
import pytest

from mcstudy.stance.body import Body, one_segment, stimulus_terms, two_segment
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.response import frf, frf_jacobian, neural_controllers, noise_response, system

F = np.array([0.0229, 0.41, 1.2, 8.0])


def paper_rows(p, s, body):
    """A(s) and b(s) of Goodworth & Peterka 2018, Appendix, typed from the paper: rows (hip, ankle)."""
    hip_delay, ankle_delay = mp.exp(-p["Td2"] * s), mp.exp(-p["Td1"] * s)
    upper_hip = s**2 * body.J2 - body.A2 * body.g  # multiplies theta2s = theta1 + theta2
    upper_ankle = s**2 * body.C2 - body.A2 * body.g
    hip_theta1 = upper_hip + s**2 * body.C1 + (p["K12"] + p["B12"] * s) * hip_delay
    hip_theta2 = upper_hip + (p["K22"] + p["B22"] * s) * hip_delay + p["Kpas2"]
    ankle_theta1 = (
        s**2 * body.J1 - body.A1 * body.g + upper_ankle + (p["K11"] + p["B11"] * s) * ankle_delay + p["Kpas1"]
    )
    ankle_theta2 = upper_ankle + (p["K21"] + p["B21"] * s) * ankle_delay
    return mp.matrix([[hip_theta1, hip_theta2], [ankle_theta1, ankle_theta2]]), mp.matrix([0, 1])


def table_frf(model, values, s):
    """H(s) in multiple precision, term by term from the declaration (no code of the package's evaluators)."""
    p = dict(zip(model.names, values, strict=True))

    def polynomial(monomials):
        return mp.fsum(
            mp.mpf(m.coefficient) * s**m.order * mp.fprod(p[name] ** power for name, power in m.powers)
            for m in monomials
        )

    filters = {f.name: polynomial(f.numerator) / polynomial(f.denominator) for f in model.filters}
    R = model.n_rows
    A, b = mp.zeros(R, R), mp.zeros(R, 1)
    for t in model.terms:
        value = mp.mpf(t.coefficient) * s**t.order * mp.fprod(p[g] for g in t.gain)
        value *= mp.fprod(filters[f] for f in t.filters) * (mp.exp(-p[t.delay] * s) if t.delay else 1)
        row, weights = model.rows.index(t.row), model.senses[t.sense]
        for c in range(R):
            A[row, c] += weights[c] * value
        b[row] -= weights[R] * value
    H = mp.lu_solve(A, b)
    return [H[c] * (filters[name] if name else 1) for c, name in enumerate(model.output_filters)]


def one(power=0, *parameters, coefficient=1.0):
    return Monomial(coefficient, power, tuple((p, k) for p, k in parameters))


def everything() -> Model:
    """Every kind of term at once: all orders, filters with parameters, products of gains, lags on both ends."""
    base = two_segment()
    p = Parameter
    return base.with_terms(
        parameters=(
            p("Ki", "", 80.0, 0.0, 200.0),
            p("Ka", "", 4.0, -10.0, 10.0),
            p("weight", "", 0.7, 0.0, 2.0),
            p("tau", "s", 0.03, 0.0, 0.2),
            p("omega", "rad/s", 12.0, 5.0, 20.0),
            p("zeta", "", 1.1, 0.5, 2.0),
            p("mass", "kg", 5.0, 0.0, 9.0),
            p("lag", "s", 0.02, 0.0, 0.1),
            p("latency", "s", 0.025, 0.0, 0.1),
            p("gain", "", 0.1, -1.0, 1.0),
        ),
        filters=(
            Filter("first", (one(),), (one(), one(1, ("tau", 1)))),
            Filter(
                "second",
                (one(0, ("omega", 2)),),
                (one(2), one(1, ("zeta", 1), ("omega", 1), coefficient=2.0), one(0, ("omega", 2))),
            ),
            Filter("sensor", (one(),), (one(), one(1, ("lag", 1)))),
        ),
        terms=(
            Term("ankle", "theta1", ("Ki",), -1, "Td1", ("first",), noisy=True),
            Term("ankle", "theta1", ("Ka",), 2, "Td1", ("second", "first"), noisy=True),
            Term("hip", "theta2s", ("K22", "weight"), 0, "Td2", ("second",), noisy=True),
            Term("hip", "theta2s", ("mass",), 2, coefficient=0.3, filters=("second",)),
            Term("ankle", "stimulus", ("gain",), 0, "latency", ("first",)),
        ),
        name="everything",
    )


def with_sensor(model: Model) -> Model:
    return Model(
        "sensor", model.parameters, model.terms, model.filters, output_filters=("sensor", "first"), provenance=""
    )


MODELS = {
    "two_segment": two_segment(),
    "hip_torque": two_segment(stimulus="hip_torque"),
    "platform": two_segment(stimulus="platform_translation"),
    "one_segment": one_segment(),
    "everything": everything(),
    "output_filters": with_sensor(everything()),
}


def test_the_two_segment_model_is_the_papers_two_rows():
    model, body = two_segment(), Body()
    p = dict(zip(model.names, model.truth, strict=True))
    A, b = system(model, model.truth, 2j * np.pi * F)
    for n, f in enumerate(F):
        expected_A, expected_b = paper_rows(p, mp.mpc(0, 2 * np.pi * f), body)
        assert A[n] == pytest.approx(np.array(expected_A.tolist(), dtype=complex), rel=1e-13)
        assert b[n] == pytest.approx(np.array(expected_b.tolist(), dtype=complex).ravel())
        expected = np.array(mp.lu_solve(expected_A, expected_b).tolist(), dtype=complex).ravel()
        assert frf(model, model.truth, F)[n] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_frf_is_the_declared_table_evaluated_in_multiple_precision(name):
    model = MODELS[name]
    H = frf(model, model.truth, F)
    with mp.workdps(30):
        for n, f in enumerate(F):
            expected = table_frf(model, [mp.mpf(v) for v in model.truth], mp.mpc(0, 2 * np.pi * f))
            assert H[n] == pytest.approx([complex(h) for h in expected], rel=1e-11)


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_match_multiple_precision_differences(name):
    """Central differences at 60 digits have an error of 1e-30, so 1e-8 is a test of the formula alone."""
    model = MODELS[name]
    H, J = frf_jacobian(model, model.truth, F)
    assert pytest.approx(frf(model, model.truth, F), rel=1e-13) == H
    with mp.workdps(60):
        for n, f in enumerate(F[1:], start=1):
            s = mp.mpc(0, 2 * np.pi * f)
            for j in range(len(model.names)):
                values, h = [mp.mpf(v) for v in model.truth], mp.mpf(10) ** -15
                sides = []
                for sign in (1, -1):
                    moved = list(values)
                    moved[j] += sign * h
                    sides.append(table_frf(model, moved, s))
                expected = np.array([complex((a - b) / (2 * h)) for a, b in zip(*sides, strict=True)])
                scale = np.abs(expected).max() or 1.0
                assert np.abs(J[n, :, j] - expected).max() <= 1e-8 * scale, (model.names[j], f)


def test_a_parameter_that_the_response_does_not_hold_has_zero_derivative():
    model = two_segment().with_terms(parameters=[Parameter("idle", "", 1.0, 0.0, 2.0)])
    assert (frf_jacobian(model, model.truth, F)[1][..., -1] == 0).all()


def test_evaluation_is_batched_over_parameter_vectors():
    model, rng = everything(), np.random.default_rng(0)
    theta = model.truth * (1 + 0.05 * rng.standard_normal((2, 3, len(model.names))))
    H, J = frf_jacobian(model, theta, F)
    assert H.shape == (2, 3, F.size, 2)
    assert J.shape == (2, 3, F.size, 2, len(model.names))
    single_H, single_J = frf_jacobian(model, theta[1, 2], F)
    assert H[1, 2] == pytest.approx(single_H, rel=1e-13)
    assert J[1, 2] == pytest.approx(single_J, rel=1e-12, abs=1e-18)


def test_the_one_segment_model_is_the_single_pendulum():
    model, body = one_segment(), Body()
    K, B, Kpas, Td = model.truth
    s = 2j * np.pi * F
    expected = 1 / ((body.J1 + body.C2) * s**2 - body.mgh + Kpas + (K + B * s) * np.exp(-Td * s))
    assert frf(model, model.truth, F) == pytest.approx(expected[:, None], rel=1e-13)


def test_platform_translation_acts_as_the_inertial_torque_of_its_acceleration():
    body, s = Body(), 2j * np.pi * F
    model = two_segment(stimulus="platform_translation")
    _, b = system(model, model.truth, s)
    expected = -(s**2)[:, None] * np.array([body.A2, body.A1 + body.A2])
    assert b == pytest.approx(expected)
    assert len(stimulus_terms("platform_translation", body)) == 2


def test_neural_controllers_are_active_plus_passive_feedback():
    model = two_segment()
    p = dict(zip(model.names, model.truth, strict=True))
    s = 2j * np.pi * F
    hip, ankle = np.exp(-p["Td2"] * s), np.exp(-p["Td1"] * s)
    NC = neural_controllers(model, model.truth, F)
    assert NC[:, 0, 0] == pytest.approx((p["K12"] + p["B12"] * s) * hip)
    assert NC[:, 0, 1] == pytest.approx((p["K22"] + p["B22"] * s) * hip + p["Kpas2"])
    assert NC[:, 1, 0] == pytest.approx((p["K11"] + p["B11"] * s) * ankle + p["Kpas1"])
    assert NC[:, 1, 1] == pytest.approx((p["K21"] + p["B21"] * s) * ankle)


def test_sensor_noise_enters_the_active_feedback_only():
    """theta = -A^-1 N n with N the four delayed controllers and without the passive stiffness."""
    model = two_segment()
    p = dict(zip(model.names, model.truth, strict=True))
    s = 2j * np.pi * F
    hip, ankle = np.exp(-p["Td2"] * s), np.exp(-p["Td1"] * s)
    N = np.array(
        [
            [(p["K12"] + p["B12"] * s) * hip, (p["K22"] + p["B22"] * s) * hip],
            [(p["K11"] + p["B11"] * s) * ankle, (p["K21"] + p["B21"] * s) * ankle],
        ]
    )
    A, _ = system(model, model.truth, s)
    assert noise_response(model, model.truth, F) == pytest.approx(-np.linalg.solve(A, np.moveaxis(N, -1, 0)))
