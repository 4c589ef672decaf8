"""Foreign bodies: Newton's laws at large angles, the closed form at small sway, nothing shared with the library."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from mcstudy_challenge.bodies import foreign_body, foreign_effects
from mcstudy_challenge.bodies.foreign_body import STEPS_PER_SAMPLE, Person, sway
from mcstudy_challenge.bodies.foreign_effects import FOREIGN
from mcstudy_challenge.bodies.foreign_recordings import person_of, simulate_foreign
from mcstudy_challenge.bodies.forms import FORMS
from mcstudy_challenge.bodies.geometry import Setting, cycle_responses
from mcstudy_challenge.bodies.other_forms import shaped
from mcstudy_challenge.cases import list_cases
from mcstudy_challenge.challenge_file import resolve
from mcstudy_challenge.design import Mix, Series, Sizes
from mcstudy_challenge.design_checks import check_series
from mcstudy_challenge.truth import make_case
from scipy.integrate import solve_ivp

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol
from mcstudy.errors import DesignError, FallsError
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SILENT
from mcstudy.stance.response import frf

BASE = two_segment()
SMALL = Protocol(amplitudes=(0.05,), cycles=3, noise=SILENT)
SETTING = Setting.of(SMALL, 8.0)


def small_response(effect: str = "", size: float = 0.0, shapes: Mapping[str, float] | None = None) -> np.ndarray:
    """FRFs (N, 2) of the last cycle at 0.05 N m, without what straight lines between samples do to the stimulus."""
    made = simulate_foreign(SMALL, BASE.truth, np.random.default_rng(0), FOREIGN.get(effect), size, shapes)
    return cycle_responses(made, SETTING)[-1] / np.sinc(SETTING.f / made.rate_hz)[:, None] ** 2


def test_at_small_sway_it_is_the_closed_form() -> None:
    expected = frf(BASE, BASE.truth, SETTING.f)
    assert np.abs(small_response() / expected - 1).max() < 1e-3


def _form(name: str, size: float, shapes: Mapping[str, float]) -> Model:
    model = shaped(FORMS[name], BASE, BASE.truth, size, shapes)
    assert model is not None
    return model


def _coupled(k: float) -> tuple[Model, np.ndarray]:
    """A muscle over both joints with equal levers adds to the stiffness of each joint, too."""
    values = dict(zip(BASE.names, BASE.truth, strict=True))
    stiffer = [values[n] + k * (n in ("Kpas1", "Kpas2")) for n in BASE.names]
    return library.apply(BASE, "biarticular_coupling"), np.array([*stiffer, k])


@pytest.mark.parametrize("effect", ["soft_ankle", "soft_hip", "muscle", "calf_reflex", "strap"])
def test_mechanisms_are_those_of_the_library_where_their_form_is(effect: str) -> None:
    """With constants that take the difference away; the challenge's own forms and the library are the reference."""
    size, shapes = FOREIGN[effect].start, {"rate": 1e6, "fall": 1.0, "delay": 0.05, "share": 1.0, "lag": 0.01, "arm": 1}
    model, theta = {
        "soft_ankle": lambda: (library.apply(BASE, "passive_damping_ankle"), np.array([*BASE.truth, size])),
        "soft_hip": lambda: (library.apply(BASE, "passive_damping_hip"), np.array([*BASE.truth, size])),
        "muscle": lambda: ((m := _form("activation_damped", 0.004, {"z": 1.0})), m.truth),
        "calf_reflex": lambda: ((m := _form("reflex_smoothed", size, {"d": 0.05, "T": 0.01})), m.truth),
        "strap": lambda: _coupled(size),
    }[effect]()
    expected = frf(model, theta, SETTING.f)
    found = small_response(effect, size, shapes)
    assert np.abs(found / expected - 1).max() < 1e-3
    assert np.abs(expected / frf(BASE, BASE.truth, SETTING.f) - 1).max() > 0.05


def _newton(y: np.ndarray, m: np.ndarray, length: np.ndarray, centre: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Angular accelerations of rods (n,) hinged end to end on the ground, from Newton's laws with the joint forces."""
    n = m.size
    phi, v = y[:n], y[n:]
    along, across = np.array([np.sin(phi), np.cos(phi)]), np.array([np.cos(phi), -np.sin(phi)])
    A, b = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)  # unknown: accelerations, then the force on each lower end
    for i in range(n):
        arms = [*length[:i], centre[i]]
        for axis in (0, 1):
            row = 3 * i + axis
            A[row, : i + 1] = m[i] * np.array(arms) * across[axis, : i + 1]
            b[row] = m[i] * sum(a * v[j] ** 2 * along[axis, j] for j, a in enumerate(arms)) - axis * m[i] * 9.81
            A[row, n + 2 * i + axis] = -1.0
            if i + 1 < n:
                A[row, n + 2 * i + 2 + axis] = 1.0
        A[3 * i + 2, i] = inertia[i]
        for axis in (0, 1):  # moment about the centre; angles turn clockwise
            A[3 * i + 2, n + 2 * i + axis] = centre[i] * across[axis, i]
            if i + 1 < n:
                A[3 * i + 2, n + 2 * i + 2 + axis] = (length[i] - centre[i]) * across[axis, i]
    return np.linalg.solve(A, b)[:n]


@pytest.mark.parametrize("segments", [2, 3])
def test_a_falling_chain_obeys_newton_at_large_angles(segments: int) -> None:
    """Lagrange's equations and the multistep method against joint forces and DOP853, from rest after a short push."""
    m, length = np.array([25.0, 45.0, 5.0])[:segments], np.array([0.85, 0.5, 0.3])[:segments]
    centre, inertia = np.array([0.5, 0.35, 0.2])[:segments], np.array([1.5, 3.0, 0.05])[:segments]
    M = np.zeros((3, 3))
    W = np.zeros(3)
    for k in range(segments):
        arm = np.array([*length[:k], centre[k], *[0.0] * (2 - k)])
        M += m[k] * np.outer(arm, arm)
        M[k, k] += inertia[k]
        W += m[k] * 9.81 * arm
    names = ("K11", "B11", "K12", "B12", "K21", "B21", "K22", "B22", "Kpas1", "Kpas2")
    person = Person(
        M11=M[0, 0], M12=M[0, 1], M22=M[1, 1], W1=W[0], W2=W[1], Td1=0.1, Td2=0.1, **dict.fromkeys(names, 0.0),
        M13=M[0, 2], M23=M[1, 2], M33=M[2, 2], W3=W[2],
    )  # fmt: skip
    rate, push = 200.0, np.zeros(200)
    push[:21] = 20.0 * (1 - np.cos(np.linspace(0, 2 * np.pi, 21)))
    times = np.arange(push.size) / rate
    found = sway(person, push, np.zeros(((push.size - 1) * STEPS_PER_SAMPLE + 1, 4)), 1 / rate / STEPS_PER_SAMPLE)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        free = _newton(y, m, length, centre, inertia)
        full = np.array([[M[i, j] * np.cos(y[i] - y[j]) for j in range(segments)] for i in range(segments)])
        torque = np.zeros(segments)
        torque[0] = np.interp(t, times, push)
        return np.concatenate([y[segments:], free + np.linalg.solve(full, torque)])

    rest, exact = np.zeros(2 * segments), {"rtol": 1e-9, "atol": 1e-11, "max_step": 0.02}
    done = solve_ivp(slope, (0, times[-1]), rest, "DOP853", times, **exact)
    assert np.abs(done.y[:2]).max() > 0.5  # far from where sines are angles
    np.testing.assert_allclose(found[:, 0], done.y[0], atol=1e-5)
    np.testing.assert_allclose(found[:, 1], done.y[1] - done.y[0], atol=1e-5)


def test_it_imports_nothing_that_a_diagnosis_uses() -> None:
    allowed = {"__future__", "collections.abc", "dataclasses", "typing", "numpy"}
    allowed |= {"mcstudy.compiling.decorators", "mcstudy_challenge.bodies.foreign_body"}  # a compiler, and itself
    for module in (foreign_body, foreign_effects):
        for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert {a.name for a in node.names} <= allowed
            elif isinstance(node, ast.ImportFrom):
                assert node.module in allowed


def test_every_mechanism_changes_the_sway_and_names_an_effect_or_none() -> None:
    protocol = Protocol(amplitudes=(5.0,), cycles=1, noise=SILENT)
    rng = np.random.default_rng(0)
    without = _angles(protocol, "", rng)
    for effect in FOREIGN.values():
        assert not effect.mechanism or effect.mechanism in library.LIBRARY
        change = np.abs(_angles(protocol, effect.name, rng) - without).max() / np.abs(without).max()
        assert 0.001 < change < 2.0, effect.name


def _angles(protocol: Protocol, name: str, rng: np.random.Generator) -> np.ndarray:
    """The first 20 s of sway with a mechanism of its first size."""
    person, effect = person_of(BASE.truth), FOREIGN.get(name)
    stimulus = protocol.waveform.waveform()[:4000]
    if effect is not None and effect.change is not None:
        person = effect.change(person, effect.start, effect.draw(rng))
    h = 1 / protocol.waveform.rate_hz / STEPS_PER_SAMPLE
    out = sway(person, stimulus, np.zeros(((stimulus.size - 1) * STEPS_PER_SAMPLE + 1, 4)), h)
    if effect is not None and effect.change is None:
        out = foreign_effects.recorded(out, protocol.waveform.rate_hz, effect.start)
    return out


def test_a_body_that_falls_is_refused() -> None:
    with pytest.raises(FallsError, match="falls with held_command"):
        simulate_foreign(SMALL, BASE.truth, np.random.default_rng(0), FOREIGN["held_command"], 5.0)


def test_the_key_of_foreign_cases_states_their_causes() -> None:
    raw = {
        "challenge": {"name": "tiny", "seed": 5, "cases": 3},
        "mix": {
            **dict.fromkeys(Mix.model_fields, 0.0),
            "foreign": 0.34,
            "foreign_mechanism": 0.33,
            "foreign_outsider": 0.33,
        },
        "sizes": {"effects": ["stimulus_lag"], "foreign": ["servo", "foot_pad"]},
        "protocol": {"amplitudes": [5.0], "cycles": 3},
    }
    file = resolve(raw)
    entries = {}
    for case in list_cases(file):
        recording, entry = make_case(file, case)
        entries[entry["kind"]] = entry
        assert (recording.name, recording.provenance) == (case.name, "challenge tiny")
    assert entries["foreign"]["effects"] == []
    mechanism, outside = entries["foreign_mechanism"], entries["foreign_outsider"]
    assert mechanism["form"] == "servo"
    assert mechanism["effects"][0]["effect"] == "stimulus_lag"
    assert mechanism["closable"]["stimulus_lag"] > 0.8  # a motor of second order is roughly one of first order
    assert outside["outsider"]["name"] == "foot_pad"
    assert outside["effects"] == []
    assert outside["delta"] > 0.5


def test_an_unknown_mechanism_is_refused() -> None:
    with pytest.raises(DesignError, match=r"sizes\.foreign: expected one of muscle, .*got 'ghost'"):
        check_series(Series(cases=1, sizes=Sizes(foreign=("ghost",))))
