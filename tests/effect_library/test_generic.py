"""Effects that are generated for a declared model, from its own table and under its own names."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.effect_library import library
from mcstudy.effect_library.generic import joints_of
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.models.catalogue import read_model
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from tests.helpers.declared import INERTIA, drive

SHIPPED = ("elbow", "two_mass_drive", "electrochemical_cell", "independent_channel", "leg_trunk_head")
F = np.geomspace(0.1, 10.0, 25)


def shipped(name: str) -> Model:
    return read_model(name).model()


def _theta(model: Model, base: Model, share: float) -> np.ndarray:
    """Nominal parameters, sizes ``share`` of the middle of their usual range, shape parameters in the middle."""
    sizes = library.library_of(base).sizes
    added = (sizes[p.name] for p in model.parameters[len(base.parameters) :])
    return np.array([*base.truth, *(sum(s.published) / 2 * (1.0 if s.is_shape else share) for s in added)])


@pytest.mark.parametrize("name", SHIPPED)
def test_an_effect_vanishes_at_its_null_and_changes_the_response_at_its_usual_size(name: str) -> None:
    base = shipped(name)
    f = F * {"electrochemical_cell": 100.0}.get(name, 1.0)
    for effect in (e for e in library.library_of(base).values() if e.kind == "linear"):
        model = library.apply(base, effect.name)
        np.testing.assert_allclose(frf(model, _theta(model, base, 0.0), f), frf(base, base.truth, f), rtol=1e-12)
        larger, nominal = frf(model, _theta(model, base, 1.0), f), frf(base, base.truth, f)
        change = np.abs(larger / nominal - 1)
        assert 1e-4 < change.max() < 10.0, effect.name


@pytest.mark.parametrize("name", ["two_mass_drive", "leg_trunk_head"])
def test_any_two_effects_combine_in_any_order(name: str) -> None:
    base = shipped(name)
    for a, b in list(combinations(library.library_of(base).linear, 2))[::7]:
        one, other = library.apply(base, a, b), library.apply(base, b, a)
        theta = _theta(one, base, 0.5)
        values = dict(zip(one.names, theta, strict=True))
        np.testing.assert_allclose(frf(other, np.array([values[n] for n in other.names]), F), frf(one, theta, F))


def test_what_the_parameters_imitate_is_no_effect() -> None:
    # the elbow has stiffness, damping, gains and one delay of its own; the drive also friction of both bodies
    elbow, motor = library.library_of(shipped("elbow")), library.library_of(drive())
    for name in ("stiffness", "damping", "feedback_gain", "feedback_delay"):
        assert f"{name}_elbow" not in elbow
    assert {"inertia_elbow", "hidden_mass_elbow", "feedback_lag_elbow", "stimulus_gain"} <= set(elbow)
    assert "damping_load" not in motor
    assert {"stiffness_load", "inertia_motor", "inertia_load", "sensor_lag_load"} <= set(motor)


def test_a_joint_has_the_inertia_of_its_table_and_the_corner_of_its_spring() -> None:
    motor, load = joints_of(drive())
    assert (motor.row, load.row) == ("motor", "load")
    for joint in (motor, load):
        assert joint.inertia == pytest.approx(INERTIA[joint.row], rel=1e-6)
    assert load.corner == pytest.approx(np.sqrt(40.0 / INERTIA["load"]), rel=0.05)  # little damped


def test_an_equation_without_inertia_is_no_joint() -> None:
    assert [j.row for j in joints_of(shipped("independent_channel"))] == ["body"]
    assert joints_of(shipped("electrochemical_cell")) == ()
    cell = library.library_of(shipped("electrochemical_cell"))
    assert cell["stimulus_rate_voltage"].size.unit == "V/A s"  # an inductance


def test_added_terms_are_those_of_the_equation_written_by_hand() -> None:
    s = 2j * np.pi * F
    k, c, bm, bl, Kp, Td = drive().truth
    shaft = k + c * s

    def responses(motor: np.ndarray, load: np.ndarray) -> np.ndarray:
        motor = motor + INERTIA["motor"] * s**2 + bm * s + shaft
        load = load + INERTIA["load"] * s**2 + bl * s + shaft
        return np.stack([load, shaft], axis=1) / (motor * load - shaft**2)[:, None]

    feedback, none = Kp * np.exp(-Td * s), np.zeros_like(s)
    w, zeta = 2 * np.pi * 5.0, 0.2
    mode = (2 * zeta * w * s + w**2) / (s**2 + 2 * zeta * w * s + w**2)
    cases = {
        "stiffness_load": ((3.0,), responses(feedback, none + 3.0)),
        "inertia_motor": ((0.004,), responses(feedback + 0.004 * s**2, none)),
        "feedback_lag_motor": ((0.03,), responses(feedback / (0.03 * s + 1), none)),
        "integral_motor": ((20.0,), responses(feedback + 20.0 / s * np.exp(-Td * s), none)),
        "hidden_mass_load": ((0.01, 5.0), responses(feedback, 0.01 * s**2 * mode)),
        "stimulus_delay": ((0.02,), responses(feedback, none) * np.exp(-0.02 * s)[:, None]),
        "sensor_gain_load": ((0.1,), responses(feedback, none) * [1.0, 1.1]),
    }
    for name, (sizes, expected) in cases.items():
        model = library.apply(drive(), name)
        np.testing.assert_allclose(frf(model, np.array([*drive().truth, *sizes]), F), expected, rtol=1e-9, err_msg=name)


def test_a_standing_body_keeps_the_library_with_published_sizes() -> None:
    for model in (two_segment(), one_segment()):
        assert library.library_of(model) is library.LIBRARY
    assert "passive_damping_ankle" not in library.library_of(drive())


def test_an_effect_has_words_with_the_names_of_the_model() -> None:
    known = library.library_of(drive())
    assert known.words("inertia_load") == "inertia at the load [inertia_load]"
    assert known.words("sensor_lag_motor") == "a lag of the sensor of motor [sensor_lag_motor]"
    assert library.places(drive()) == ("motor", "load", "stimulus", "sensor")


def test_the_command_lists_the_effects_of_a_model(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gap", "effects", "--model", "elbow"]) == Exit.DONE
    listed = [block.split()[0] for block in capsys.readouterr().out.split("\n\n")]
    assert listed == list(library.library_of(shipped("elbow")))
    assert "passive_damping_ankle" not in listed


def test_an_effect_that_a_model_does_not_have_is_refused_with_those_that_it_has() -> None:
    with pytest.raises(InputError, match=r"unknown effect 'passive_damping_ankle'; the library has inertia_elbow, .*"):
        mc.simulate(["passive_damping_ankle"], model="elbow", cycles=1, rate_hz=100.0)
