"""Every model that ships responds as other libraries, formulas and publications say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import freqs

from mcstudy.models.catalogue import read_model
from mcstudy.models.check import check_stability
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate


def model(name: str) -> Model:
    return read_model(name).model()


def responses(name: str, hz: object) -> np.ndarray:
    m = members(model(name))[0]
    return frf(m, m.truth, np.asarray(hz, dtype=float))


def test_the_two_mass_drive_is_that_of_its_transfer_functions_with_the_controller() -> None:
    v = dict(zip(model("two_mass_drive").names, model("two_mass_drive").truth, strict=True))
    Jm, P, D = 0.02, 12.0, 0.35
    motor_alone, load_alone = [Jm, v["bm"] + v["Bs"], v["Ks"]], [v["Jl"], v["bl"] + v["Bs"], v["Ks"]]
    shaft = [v["Bs"], v["Ks"]]
    both = np.polysub(np.polymul(motor_alone, load_alone), np.polymul(shaft, shaft))[:-1]  # turns freely: no constant
    f = np.array([0.3, 2.0, 6.5, 13.0, 35.0])
    w = 2 * np.pi * f
    motor, load = (freqs(top, np.append(both, 0.0), w)[1] for top in (load_alone, shaft))
    s = 1j * w
    loop = 1 + (P * load + D * s * motor) * np.exp(-v["Td"] * s)
    np.testing.assert_allclose(
        responses("two_mass_drive", f), np.stack([motor, load], axis=-1) / loop[:, None], rtol=1e-9
    )


def test_the_impedance_of_the_cell_is_that_of_its_circuit() -> None:
    f = np.geomspace(1, 1e5, 26)
    parallel = 1 / (1 / 100 + 2j * np.pi * f * 10e-6)  # of R1 and C
    np.testing.assert_allclose(responses("electrochemical_cell", f)[:, 0], 10 + parallel, rtol=1e-12)
    assert check_stability(read_model("electrochemical_cell")) == -np.inf


PASMA = np.array([0.05, 0.15, 0.45, 0.85, 1.25, 2.45])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("independent_channel", "1.763686+.666279j 2.243617-.190832j 2.030009-2.199293j "
         "-1.800654-.771314j -.562688+.161623j .007328+.064483j"),
        ("independent_channel_visual", "1.713794+.571434j 2.109592-.345634j 1.504146-2.340508j "
         "-1.871402-.275961j -.519157+.354792j .016091+.128675j"),
    ],
)  # fmt: skip
def test_the_independent_channel_model_has_the_responses_of_its_closed_form(name: str, expected: str) -> None:
    """Parameters: Table 1 of Pasma et al. 2017; responses of the closed form, by another program."""
    np.testing.assert_allclose(responses(name, PASMA)[:, 0], [complex(x) for x in expected.split()], atol=1e-6)


def test_three_segments_have_the_responses_and_the_roots_of_an_independent_program() -> None:
    """Mechanics of that program: checked against a Lagrangian of sympy and against MuJoCo."""
    expected = """
    1    5.358047939e-03-6.517584667e-05j -2.480638195e-03-1.123622857e-04j -5.783628590e-03+5.892538777e-05j
    27   3.954798092e-03-4.343974415e-03j -5.144514649e-03+1.634921585e-03j -4.640746444e-03+6.172142588e-03j
    151  2.553266317e-03-4.201674459e-06j -6.446546077e-03+3.847432343e-03j 5.107649170e-03-8.263746509e-03j
    351  -6.064073272e-04-3.894005436e-04j 1.199878440e-03+7.586218508e-04j -5.500023401e-04-3.267187159e-04j
    """
    rows = np.array([[complex(x) for x in row.split()] for row in expected.strip().splitlines()])
    H = responses("three_segment", rows[:, 0].real / 43.72)
    np.testing.assert_allclose(H, rows[:, 1:], rtol=2e-9, atol=1e-12)
    assert read_model("three_segment").values()["M11"] == pytest.approx(72.641310, rel=1e-7)
    assert read_model("three_segment").values()["G1"] == pytest.approx(655.7946, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "growth"),
    [("independent_channel", -0.2224), ("three_segment", -2.188060), ("leg_trunk_head", -1.200)],
)
def test_the_rightmost_roots_are_those_of_other_programs(name: str, growth: float) -> None:
    m = model(name)
    assert float(growth_rate(m, m.truth)) == pytest.approx(growth, abs=5e-4 if name == "leg_trunk_head" else 6e-5)
