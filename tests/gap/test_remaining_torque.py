"""The torque that a mechanism leaves: against SciPy's own fit and transfer functions, and known torques come back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import freqs

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.rational_torque import Loop, Path, extended, paths
from mcstudy.gap.questions.remaining_torque import _candidates, remaining_torque
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf, system
from mcstudy.stance.stability import growth_rate
from tests.helpers.examples import module

BASE = opened(two_segment())
ADDED = {
    0: [150.0, 20.0],
    1: [0.0, 10.0, 300.0, 6.0],
    2: [100.0, 0.0, -150.0, 200.0, 9.0, 0.3],
    3: [0.0, 5.0, 150.0, 200.0, -100.0, 4.0, 12.0, 0.4],
}
"""Parameters of a torque with so many poles."""


def at_truth(data: Data, theta: np.ndarray | None = None) -> Fitted:
    fitter = Fitter(BASE, weak_prior(BASE, BASE), data.f)
    return fitter.best(data, (BASE.truth if theta is None else theta)[None])


@pytest.fixture(scope="module")
def low(plain_lines: list[Lines]) -> Data:
    """Every second line of a recording without a gap, up to 3 Hz."""
    data = Data.of(plain_lines[0])
    keep = np.flatnonzero(data.f < 3.0)[::2]
    return Data(data.f[keep], data.y[keep], data.weight[keep])


@pytest.mark.parametrize("poles", [0, 1, 2, 3])
def test_the_fraction_is_the_transfer_function(poles: int) -> None:
    path, f, added = Path("ankle", "theta1"), np.geomspace(0.05, 8, 40), np.array(ADDED[poles])
    above, below = path.fraction(poles, added)
    assert len(below) == poles + 1
    expected = freqs(above[::-1], below[::-1], 2 * np.pi * f)[1]
    np.testing.assert_allclose(path.transfer(poles, added, f), expected, rtol=1e-9)


@pytest.mark.parametrize("sense", ["theta1", "theta2", "stimulus"])
@pytest.mark.parametrize("poles", [0, 3])
def test_the_model_with_a_torque_is_the_loop_with_that_torque(low: Data, sense: str, poles: int) -> None:
    """A theta + e_k G x = b, solved here."""
    path, s, added = Path("hip", sense), 2j * np.pi * low.f, 0.1 * np.array(ADDED[poles])
    added[2 + poles :] *= 10
    model, prior = extended(at_truth(low), path, poles, low.f, 1000.0)
    assert prior.mean.size == len(model.names) == BASE.truth.size + len(added)
    A, b = (x.copy() for x in system(BASE, BASE.truth, s))
    G, k = path.transfer(poles, added, low.f), BASE.rows.index("hip")
    if sense == "stimulus":
        b[:, k] -= G
    else:
        A[:, k, BASE.angles.index(sense)] += G
    expected = np.linalg.solve(A, b[..., None])[..., 0]
    np.testing.assert_allclose(frf(model, np.append(BASE.truth, added), low.f), expected, rtol=1e-9)


def test_what_a_parameter_of_the_model_is_already_is_left_out() -> None:
    of = {(p.row, p.sense): p.linear for p in paths(BASE)}
    damped = {(p.row, p.sense): p.linear for p in paths(library.apply(BASE, "passive_damping_ankle"))}
    assert of["ankle", "theta1"] == of["hip", "theta2"] == ("torque_B",)
    assert of["ankle", "theta2"] == of["hip", "stimulus"] == ("torque_K", "torque_B")
    assert damped["ankle", "theta1"] == ()
    assert len(of) == 6


@pytest.mark.parametrize("poles", [1, 2])
def test_scipy_finds_no_better_fit_and_the_same_torque(low: Data, poles: int) -> None:
    """The same cost, written here in full, from our minimum and from a moved one, with SciPy's derivatives."""
    path, added, s = Path("ankle", "theta2"), np.array(ADDED[poles]), 2j * np.pi * low.f
    A, b = (x.copy() for x in system(BASE, BASE.truth, s))
    A[:, BASE.rows.index("ankle"), 1] += path.transfer(poles, added, low.f)
    noise = low.y - frf(BASE, BASE.truth, low.f)
    data = low.with_y(np.linalg.solve(A, b[..., None])[..., 0] + noise)
    base = at_truth(data)
    ours = next(c.fitted for c in _candidates(base, data, Loop.of(base, data.f), [path]) if c.poles == poles)
    P = BASE.truth.size

    def cost(x: np.ndarray) -> np.ndarray:
        g, theta = x[P:] * ours.prior.scale[P:], x[:P] * ours.prior.scale[:P]
        matrix, drive = (z.copy() for z in system(BASE, theta, s))
        G = g[0] + g[1] * s
        if poles == 1:
            G = G + g[2] * g[3] / (s + g[3])
        else:
            v, zeta = g[4:]
            G = G + (g[2] * v**2 + g[3] * v * s) / (s**2 + 2 * zeta * v * s + v**2)
        matrix[:, BASE.rows.index("ankle"), 1] += G
        r = np.einsum("nij,nj->ni", data.weight, data.y - np.linalg.solve(matrix, drive[..., None])[..., 0]).ravel()
        return np.concatenate([r.real, r.imag, x - ours.prior.mean / ours.prior.scale])

    scale, bounds = ours.prior.scale, (ours.model.lower / ours.prior.scale, ours.model.upper / ours.prior.scale)
    for moved in (1.0, 1.03) if poles == 1 else (1.0,):
        start = np.clip(ours.theta * moved / scale, bounds[0] + 1e-9, bounds[1] - 1e-9)
        theirs = least_squares(cost, start, bounds=bounds, method="trf", xtol=1e-10, ftol=1e-10)
        assert 2 * theirs.cost > ours.chi2 + ours.penalty - 1e-3
        if moved == 1.0:
            assert 2 * theirs.cost == pytest.approx(ours.chi2 + ours.penalty, abs=1e-3)
            G = path.transfer(poles, theirs.x[P:] * scale[P:], data.f)
            np.testing.assert_allclose(G, path.transfer(poles, ours.theta[P:], data.f), rtol=5e-3)


def test_a_known_torque_is_found_with_its_interval_and_nothing_without_one(low: Data) -> None:
    path, poles, added = Path("ankle", "theta2"), 2, np.array([0.0, 0.0, 0.0, 60.0, 9.0, 0.2])
    model, _ = extended(at_truth(low), path, poles, low.f, 1000.0)
    noise = low.y - frf(BASE, BASE.truth, low.f)
    data = low.with_y(frf(model, np.append(BASE.truth, added), low.f) + noise)
    rng = np.random.default_rng(0)
    found = remaining_torque(at_truth(data), data, np.ones(data.f.size), rng, [path])
    assert found.found
    assert (found.row, found.sense) == ("ankle", "theta2")
    assert found.poles >= 2
    true = path.transfer(poles, added, data.f)
    gain, phase = found.at(found.clearest_hz)
    k = int(np.abs(data.f - found.clearest_hz).argmin())
    assert gain.low < abs(true[k]) < gain.high
    assert phase.low < np.rad2deg(np.angle(true[k])) < phase.high
    assert 0 < gain.low < gain.high < 4 * abs(true[k])
    assert found.poles_weight.sum() == pytest.approx(1.0)
    nothing = remaining_torque(at_truth(low), low, np.full(low.f.size, np.nan), rng, [path])
    assert not nothing.found
    assert nothing.rms is None


def test_the_coverage_study_draws_a_body_that_stands_and_counts() -> None:
    example = module("remaining_torque")
    model, values, added, path, poles = example.drawn(3)
    assert poles == 3
    np.testing.assert_array_equal(values[-len(path.names(3)) :], added)
    assert growth_rate(model, values) < 0
    keys = ("rms", *(f"{what} {at}" for what in ("gain", "phase") for at in ("0.3", "1", "3", "clearest")))
    cases = [
        {"found": k > 0, "path": k > 1, "path_probability": 0.5, "poles": 1, "poles_found": k, **dict.fromkeys(keys, k)}
        for k in range(4)
    ]
    said = example.table(cases)
    assert "4 recordings, in 3 of them a torque is found" in said
    assert "true path, among those found: 66.7 %" in said
    assert "interval of gain clearest holds the truth, path given: 75.0 %" in said
