"""Stability and simulation of loops of one to four rows, with auxiliary unknowns, against other programs' numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from linked_segments import body
from linked_segments import model as linked
from scipy import linalg, optimize

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Filter, Model, Output, OutputTerm, Parameter, Term
from mcstudy.stance.realize import realise
from mcstudy.stance.response import frf, noise_response, system
from mcstudy.stance.rules import Rules
from mcstudy.stance.simulate_time import simulate
from mcstudy.stance.stability import Proof, growth_rate, rightmost_root, roots_chebyshev

PERIOD, LINES = 8.0, np.array([1, 3, 7, 11, 19, 27])  # s; 0.1 to 3.4 Hz
FORCE = {"Kt": 1.38e-4, "Kp": 1019.25, "Kd": 354.85, "tau": 0.151}


def channel(values: dict[str, float], force: str = "", stimulus: str = "Wp") -> Model:
    """The independent-channel model: (J s^2 - mgh + Kpas + Bpas s) angle = torque + (Kpas + Bpas s) tilt, and

    torque = (Kp + Kd s + Ki/s) e^(-tau s) A(s) (W tilt - angle + F(s) torque); F: "integrator" Kt/s or "lag".
    """
    given = dict(values)
    J, mgh = given.pop("J"), given.pop("mgh")
    active = ("activation",) if "w0" in given else ()
    terms = [
        Term("body", "angle", order=2, coefficient=J),
        Term("body", "angle", coefficient=-mgh),
        Term("body", "torque", coefficient=-1.0),
        Term("control", "torque"),
    ]
    for gain, order in (("Kpas", 0), ("Bpas", 1)):
        senses = ("angle", "stimulus") if stimulus == "Wp" else ("angle",)
        terms += [Term("body", sense, gain, order) for sense in senses if gain in given]
    for gain, order in (("Kp", 0), ("Kd", 1), ("Ki", -1)):
        if gain in given:
            terms += [
                Term("control", "angle", gain, order, "tau", active, noisy=True),
                Term("control", "stimulus", (gain, stimulus), order, "tau", active),
            ]
            if force == "integrator":
                terms.append(Term("control", "torque", (gain, "Kt"), order - 1, "tau", active, -1.0, noisy=True))
            elif force == "lag":
                terms.append(Term("control", "torque", gain, order, "tau", (*active, "lag"), -1.0, noisy=True))
    filters = [Filter("activation", "w0**2", "w0**2 + 2*beta*w0*s + s**2")] if active else []
    filters += [Filter("lag", "Kt", "1 + Ft*s")] if force == "lag" else []
    parameters = (Parameter(name, "", value, -1e4, 1e4) for name, value in given.items())
    names = {"rows": ("body", "control"), "angles": ("angle", "torque")}
    return Model("channel", tuple(parameters), tuple(terms), tuple(filters), stimulus_unit="rad", **names)


_C = {"J": 81.1, "mgh": 732.2, "Kp": 967.0, "Kd": 344.0, "tau": 0.151, "Wp": 0.53, "Wv": 0.2}
_D = {**_C, "Kpas": 91.0, "Bpas": 34.0, "Kt": 0.0018, "Ft": 16.5}
SETS = {
    "integrated force": ({"J": 90, "mgh": 755, **FORCE, "Wp": 0.534, "Wv": 0.2}, "integrator"),
    "lagged force": (
        {"J": 90, "mgh": 755, "Kp": 1057, "Kd": 302, "tau": 0.16, "Kt": 8.727e-5, "Ft": 20, "Wp": 0.45, "Wv": 0.45},
        "lag",
    ),
    "integral": ({**_C, "Ki": 86.0}, ""),
    "intrinsic": (_D, "lag"),
    "activation": ({**_D, "Kd": 300.0, "tau": 0.06, "w0": 16.8, "beta": 1.0}, "lag"),
    "Pasma 2017": (
        # Table 1 of Pasma et al. 2017, Front Comput Neurosci 11:99
        {"J": 66, "mgh": 75 * 9.81 * 0.83, "Kp": 943.9, "Kd": 313.5, "tau": 0.097, "Wp": 0.8, "Wv": 0.8}
        | {"Kpas": 40.5, "Bpas": 68.8, "w0": 16.8, "beta": 0.99, "Kt": 0.0018, "Ft": 17.4},
        "lag",
    ),
}
"""Values in N, m, rad, s, and the kind of force feedback; round examples inside published ranges but for the last."""

ROOTS = {
    "integrated force": (-0.531554, -2.434018, -2.858472 + 2.172856j),
    "lagged force": (-0.061745, -1.134584 + 2.223859j),
    "integral": (-0.675359 + 0.347260j,),
    "intrinsic": (-0.305893, -1.842340),
    "activation": (-0.290979, -1.320714 + 2.645862j),
    "Pasma 2017": (-0.2224014, -1.14788 + 4.08013j, -2.22818),
}
"""Rightmost roots, 1/s, computed by another program from the closed form."""

RESPONSES = {
    ("integrated force", "Wp"): (0.9146096 + 1.0336159j, 0.2103594 - 1.8692275j, -0.0537859 + 0.1355961j),
    ("integrated force", "Wv"): (0.3425504 + 0.3871221j, 0.0787863 - 0.7000852j, -0.0201445 + 0.0507851j),
    ("lagged force", "Wp"): (1.5870751 - 0.1005956j, -0.4162592 - 1.7606287j, -0.0252790 + 0.1017156j),
    ("integral", "Wp"): (1.4576975 + 0.8999891j, 0.1655204 - 1.5124694j, -0.0616583 + 0.1527302j),
    ("intrinsic", "Wp"): (1.3444780 + 0.6857623j, 0.7297160 - 1.4618664j, -0.0735409 + 0.1194979j),
    ("intrinsic", "Wv"): (0.4487149 + 0.1977837j, 0.2015208 - 0.4918751j, -0.0233272 + 0.0558326j),
    ("activation", "Wv"): (0.4366821 + 0.2115600j, 0.0233980 - 0.8085888j, -0.0112576 + 0.0245784j),
    ("Pasma 2017", "Wp"): (1.763686 + 0.666279j, 2.030009 - 2.199293j, 0.007328 + 0.064483j),
    ("Pasma 2017", "Wv"): (1.713794 + 0.571434j, 1.504146 - 2.340508j, 0.016091 + 0.128675j),
}
"""Of the angle to a tilt of the surface (Wp) or the surround (Wv) at 0.05, 0.45 and 2.45 Hz, by the same program."""


def multisine(rate: float, cycles: int) -> np.ndarray:
    """A smooth stimulus with its derivatives, (n, 3)."""
    t, w = np.arange(round(cycles * PERIOD * rate)) / rate, 2 * np.pi * LINES / PERIOD
    wave = np.exp(1j * (w * t[:, None] + np.arange(LINES.size))) / LINES
    return np.stack([(wave * (1j * w) ** k).sum(axis=1).imag for k in range(3)], axis=1)


def simulated_errors(model: Model, rate: float = 200.0) -> np.ndarray:
    """Largest relative errors (Y,) of responses simulated until they are steady."""
    n = round(PERIOD * rate)
    growth = float(growth_rate(model, model.truth))
    u = multisine(rate, 2 + int(25 / -growth / PERIOD))
    sway = simulate(model, model.truth, u, rate).theta[-n:]
    measured = np.fft.rfft(sway, axis=0)[LINES] / np.fft.rfft(u[-n:, 0])[LINES, None]
    expected = frf(model, model.truth, LINES / PERIOD)
    return np.abs(measured - expected).max(axis=0) / np.abs(expected).max(axis=0)


@pytest.mark.parametrize("name", SETS)
def test_a_loop_with_a_torque_among_its_unknowns_has_the_roots_of_its_closed_form(name: str) -> None:
    m = channel(*SETS[name])
    found = rightmost_root(m, m.truth)
    assert found.proof == Proof.SEARCH
    assert complex(found.root) == pytest.approx(ROOTS[name][0], abs=2e-6)
    reference = roots_chebyshev(m, m.truth)
    upper = reference[reference.imag >= 0][: len(ROOTS[name])]
    assert upper == pytest.approx(np.array(ROOTS[name]), abs=2e-5)


@pytest.mark.parametrize(("name", "stimulus"), RESPONSES)
def test_a_loop_with_a_torque_among_its_unknowns_moves_as_its_closed_form(name: str, stimulus: str) -> None:
    m = channel(*SETS[name], stimulus)
    at = np.array([0.05, 0.45, 2.45])
    assert frf(m, m.truth, at)[:, 0] == pytest.approx(np.array(RESPONSES[name, stimulus]), abs=6e-7)
    assert simulated_errors(m).max() < 3e-8


def test_force_feedback_through_the_controller_is_neutral_with_its_chain_where_theory_puts_it() -> None:
    """Kt Kd J s^2 e^(-tau s) has the order of the inertia: roots approach Re s = ln(Kt Kd) / tau."""
    m = channel(*SETS["integrated force"])
    chain = np.log(FORCE["Kt"] * FORCE["Kd"]) / FORCE["tau"]
    assert chain == pytest.approx(-20.0, abs=0.05)
    far = optimize.newton(lambda s: np.linalg.det(system(m, m.truth, np.array([s]))[0][0]) / s**2, chain + 3000j)
    assert far.imag == pytest.approx(3000.0, abs=2 * np.pi / FORCE["tau"])
    assert far.real == pytest.approx(chain, abs=0.1)
    theta = m.truth.copy()
    for gain in (0.98, 1.02):
        theta[m.names.index("Kt")] = gain / FORCE["Kd"]
        theta[m.names.index("Kp")] = 0.0
        found = rightmost_root(m, theta)
        assert found.root.real >= np.log(gain) / FORCE["tau"] - 1e-9
        assert found.proof in (Proof.CHAIN, Proof.SEARCH, Proof.RESTART)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_a_loop_without_delays_has_the_eigenvalues_of_its_matrices(n: int) -> None:
    m, (M, G, g) = linked(n), body(n)
    theta = np.where([name.startswith("Td") for name in m.names], 0.0, m.truth)
    stiffness, identity, zero = G + np.diag(g["Kpas"]) + g["K"], np.eye(n), np.zeros((n, n))
    pencil = np.block([[zero, identity], [-stiffness, -g["B"]]]), linalg.block_diag(identity, M)
    expected = linalg.eigvals(*pencil)
    assert growth_rate(m, theta) == pytest.approx(expected.real.max(), rel=1e-10)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_every_root_is_certified_and_the_chebyshev_discretisation_has_none_further_right(n: int) -> None:
    m, rng = linked(n), np.random.default_rng(n)
    theta = m.truth * rng.uniform(0.6, 1.4, (40, len(m.names)))
    found = rightmost_root(m, theta)
    assert np.isin(found.proof, (Proof.SEARCH, Proof.RESTART, Proof.CHEBYSHEV)).all()
    reference = [roots_chebyshev(m, t, 26)[0].real for t in theta[:8]]
    assert found.root.real[:8] == pytest.approx(np.array(reference), abs=1e-7)
    for t, root in zip(theta, found.root, strict=True):
        near, beside = (np.linalg.det(system(m, t, np.array([s]))[0][0]) for s in (root, root + 1e-3))
        assert abs(near) < 1e-7 * abs(beside)


def test_three_segments_stand_with_the_roots_that_another_program_computed() -> None:
    m = linked(3)
    assert complex(rightmost_root(m, m.truth).root) == pytest.approx(-2.188060 + 2.920036j, abs=1e-6)
    roots = roots_chebyshev(m, m.truth)
    assert roots[roots.imag > 0][1] == pytest.approx(-3.892650 + 21.341179j, abs=1e-5)


def with_muscle(m: Model) -> Model:
    """The active torque of the ankle through a muscle: one more unknown, of first order, also fed back late."""
    to_muscle = [t.noisy and t.row == "ankle" for t in m.terms]
    terms = [
        replace(t, row="muscle", coefficient=-1.0) if moves else t for t, moves in zip(m.terms, to_muscle, strict=True)
    ]
    terms += [
        Term("ankle", "torque"),
        Term("muscle", "torque"),
        Term("muscle", "torque", order=1, coefficient=0.01),
        Term("muscle", "torque", coefficient=0.05, delay="Tdankle", noisy=True),
        Term("muscle", "torque", order=1, coefficient=0.001, delay="Tdknee"),
    ]
    return replace(m, rows=(*m.rows, "muscle"), angles=(*m.angles, "torque"), terms=tuple(terms), output_filters=())


OUTPUTS = (
    Output("centre of mass", (OutputTerm("ankle"), OutputTerm("hip", 0.2)), "rad"),
    Output("rate", (OutputTerm("knee", order=1),), "rad/s"),
    Output("torque", (OutputTerm("ankle", 70.0, 2), OutputTerm("ankle", -600.0), OutputTerm("stimulus", -1.0)), "N m"),
    Output("integral", (OutputTerm("hip", order=-1), OutputTerm("stimulus", 1e-3, -1), OutputTerm("knee")), "rad s"),
)
LOOPS = {
    "three joints": linked(3),
    "three joints and a muscle": with_muscle(linked(3)),
    "declared outputs": linked(3, OUTPUTS),
    "outputs through a sensor": replace(
        linked(3, OUTPUTS), filters=(Filter("lag", "1", "1 + 0.05*s"),), output_filters=(None, "lag", "lag")
    ),
    "a torque from the motion": Model(  # an algebraic unknown that reads an acceleration
        "inverse",
        (Parameter("K", "", 30.0, 0.0, 99.0), Parameter("B", "", 5.0, 0.0, 99.0), Parameter("T", "s", 0.05, 0.0, 1.0)),
        (
            Term("joint", "angle", order=2, coefficient=2.0),
            Term("joint", "angle", "B", 1),
            Term("joint", "angle", "K"),
            Term("joint", "torque", coefficient=0.2, delay="T"),
            Term("joint", "stimulus"),
            Term("dynamics", "torque"),
            Term("dynamics", "angle", order=2, coefficient=-2.0),
            Term("dynamics", "angle", order=2, coefficient=-0.3, delay="T"),
        ),
        rows=("joint", "dynamics"),
        angles=("angle", "torque"),
    ),
    "a torque fed back at once, through a filter, and a step and a half late": Model(
        "feedback",
        (
            Parameter("K", "", 30.0, 0.0, 99.0),
            Parameter("B", "", 5.0, 0.0, 99.0),
            Parameter("T", "s", 0.0075, 0.0, 1.0),
        ),
        (
            Term("joint", "angle", order=2, coefficient=2.0),
            Term("joint", "torque"),
            Term("joint", "stimulus"),
            Term("control", "torque", coefficient=-1.0),
            Term("control", "angle", "K", noisy=True),
            Term("control", "angle", "B", 1, "T", noisy=True),
            Term("control", "torque", filters="lag", coefficient=-0.3, noisy=True),
            Term("control", "torque", coefficient=-0.2, delay="T"),
        ),
        (Filter("lag", "1", "1 + 0.3*s"),),
        rows=("joint", "control"),
        angles=("angle", "torque"),
    ),
    "rate and angle": Model(  # one joint as two rows of first order
        "first order",
        (Parameter("K", "", 30.0, 0.0, 99.0), Parameter("B", "", 5.0, 0.0, 99.0), Parameter("T", "s", 0.05, 0.0, 1.0)),
        (
            Term("motion", "rate", order=1, coefficient=2.0),
            Term("motion", "rate", "B", delay="T", noisy=True),
            Term("motion", "angle", "K", delay="T", noisy=True),
            Term("motion", "stimulus"),
            Term("kinematics", "angle", order=1),
            Term("kinematics", "rate", coefficient=-1.0),
        ),
        rows=("kinematics", "motion"),
        angles=("angle", "rate"),
    ),
}


@pytest.mark.parametrize("name", LOOPS)
def test_simulation_agrees_with_the_closed_form(name: str) -> None:
    assert simulated_errors(LOOPS[name]).max() < 1e-6


@pytest.mark.parametrize("name", LOOPS)
def test_the_chebyshev_discretisation_of_the_simulated_equations_has_the_same_rightmost_root(name: str) -> None:
    m = LOOPS[name]
    found = rightmost_root(m, m.truth)
    assert found.proof in (Proof.SEARCH, Proof.RESTART)
    assert roots_chebyshev(m, m.truth)[0].real == pytest.approx(found.root.real, abs=1e-7)


def test_noise_on_three_joints_and_on_a_torque_evokes_the_sway_of_the_closed_form() -> None:
    m = LOOPS["three joints and a muscle"]
    n, rate, k = 1600, 200.0, 7
    t = 2 * np.pi * k * np.arange(4 * n) / n
    for source in range(4):
        noise = np.zeros((t.size, 4))
        noise[:, source] = 0.01 * np.cos(t)
        sway = simulate(m, m.truth, np.zeros(t.size), rate, noise=noise).theta[-n:]
        expected = noise_response(m, m.truth, np.array([k * rate / n]))[0, :, source]
        assert np.fft.rfft(sway, axis=0)[k] / n / 0.005 == pytest.approx(expected, rel=1e-5)


def test_rules_act_on_every_row_and_angle_of_three_joints() -> None:
    m, u = linked(3), 3.0 * multisine(200.0, 1)
    free = simulate(m, m.truth, u, 200.0)
    limit = 0.9 * np.abs(free.active_torque).max(axis=0)
    cut = simulate(m, m.truth, u, 200.0, rules=Rules(torque_limit=tuple(limit)))
    assert np.abs(cut.active_torque).max(axis=0) == pytest.approx(limit)
    still = simulate(m, m.truth, 1e-6 * u[:100], 200.0, rules=Rules(dead_angle=(1.0,) * 3, dead_rate=(1.0,) * 3))
    assert (still.active_torque == 0).all()
    with pytest.raises(ModelError, match="rules dead_angle: expected 3 numbers, one for each angle or row, got"):
        simulate(m, m.truth, u, 200.0, rules=Rules(dead_angle=(0.1, 0.2)))


def two(*terms: Term) -> Model:
    parameters = (Parameter("a", "", 1.0, -9.0, 9.0), Parameter("T", "s", 0.1, 0.0, 1.0))
    return Model("two", parameters, terms, rows=("first", "second"), angles=("x", "y"))


X, Y = Term("first", "x"), Term("second", "y")
REFUSED = {
    "an algebraic loop without a solution": (
        two(Term("first", "x"), Term("first", "y", coefficient=-1.0), Y, Term("second", "x", coefficient=-1.0)),
        "the undelayed terms do not determine x, y, the highest derivatives",
    ),
    "a constraint between motions": (
        two(Term("first", "x"), Term("first", "y"), replace(Y, order=2), Term("second", "x", order=2)),
        "do not determine x'', y'', the highest derivatives",
    ),
    "a derivative of what has none": (
        two(X, Y, Term("second", "x", "a", 1, "T")),
        "second row: a term grows faster than s.0, as the undelayed ones do",
    ),
    "an output that reads it": (
        replace(two(X, Y), outputs=(Output("rate of x", (OutputTerm("x", order=1),)),)),
        "output rate of x: reads a derivative beyond order 0",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_simulated_is_said_in_one_line(name: str) -> None:
    m, message = REFUSED[name]
    with pytest.raises(ModelError, match=message) as refused:
        realise(m, m.truth)
    assert "\n" not in str(refused.value)


def test_a_row_too_fast_for_the_step_is_refused() -> None:
    m = two(Term("first", "x", coefficient=5e3), Term("first", "x", order=1), Y)
    with pytest.raises(ModelError, match=r"a row with a pole at 5e.03 1/s is too fast for the step"):
        simulate(m, m.truth, np.zeros(10), 200.0)
