"""The causes of the paper's Fig. 2D that `pipelines/examples/fig2d.py` tells apart."""

from types import ModuleType

import numpy as np
import pytest
from examples import module


@pytest.fixture(scope="module")
def fig2d() -> ModuleType:
    return module("fig2d")


@pytest.fixture(scope="module")
def found(fig2d: ModuleType) -> dict[str, object]:
    return {case.name: fig2d.run(case) for case in fig2d.cases(1000.0)}


def test_straight_lines_between_samples_are_sinc_squared_at_any_rate_of_the_solver(fig2d, found) -> None:
    expected = np.sinc(fig2d.points.f / 200.0)[:, None] ** 2 - 1
    for name in ("straight between samples, as the PRTS is", "the same, solver faster"):
        result = found[name]
        assert np.abs(result.error - expected).max() < 2e-5
        assert result.repeats == pytest.approx(100, abs=0.01)
    assert abs(expected).max() == pytest.approx(0.0052, rel=0.01)


def test_a_held_torque_comes_half_a_sample_late(fig2d, found) -> None:
    error = found["held between samples, solver faster"].error
    late = 0.5 / 200.0 - 0.5 / 1000.0  # the simulator takes one of its own steps from value to value
    phase = -2 * np.pi * fig2d.points.f * late
    assert np.angle(1 + error[:, 0]) == pytest.approx(phase, abs=1e-4)


def test_sampling_everything_faster_would_have_removed_it(fig2d, found) -> None:
    names = ("the same, solver faster", "sampled, solved and analysed faster")
    slow, fast = (found[name].error[fig2d.AT[2]] for name in names)
    assert np.abs(slow / fast) == pytest.approx(25, rel=0.05)


def test_a_transient_neither_repeats_nor_is_small(found) -> None:
    for name in ("first cycle kept", "slow mode"):
        assert found[name].repeats < 90
        assert found[name].fit[0] > 0.1
    slow, fast = (found[name].error for name in ("first cycle kept", "first cycle kept, solver faster"))
    assert np.linalg.norm(slow - fast) < 0.15 * np.linalg.norm(slow)  # it persists at any rate


def test_knowing_what_is_between_the_samples_removes_it(found) -> None:
    for name in ("straight, drive times sinc squared", "held, drive times sinc and half a sample late"):
        assert np.abs(found[name].error).max() < 1e-5
        assert found[name].fit[1] < 0.01


def test_a_recording_can_be_given_a_held_torque(fig2d, tmp_path) -> None:
    n, source = fig2d.coarse.samples, tmp_path / "straight"
    source.mkdir()
    torque = fig2d.coarse.waveform()
    straight = np.degrees(fig2d.simulate(fig2d.body, fig2d.body.truth, torque, 200.0).angle)
    noise = np.random.default_rng(1).normal(size=(n, 2))
    record = np.column_stack([np.arange(n) / 200.0, torque, straight + noise])
    np.savetxt(source / "trial1.csv", record, delimiter=",", header="time,stimulus,theta1,theta2", comments="")
    fig2d.held_recording(source, tmp_path / "held")
    held = np.loadtxt(tmp_path / "held" / "trial1.csv", delimiter=",", skiprows=1)
    assert held[:, :2] == pytest.approx(record[:, :2])
    # sway without the noise comes 2.25 ms later
    sway, late = straight[:, 0], held[:, 2] - noise[:, 0]
    rate = np.gradient(sway, 1 / 200.0)
    assert -(late - sway) @ rate / (rate @ rate) == pytest.approx(2.25e-3, rel=0.02)
