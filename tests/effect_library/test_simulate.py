"""Recordings made in the time domain: they agree with the closed form they never used, and are reproducible."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest
from commands import refused
from mcstudy_challenge.bodies.out_of_library import OUT_OF_LIBRARY, simulate_out_of_library

from mcstudy.cli import main
from mcstudy.cli.verbs import simulate
from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol, body_with_effects, draw_case, simulate_recording
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SILENT
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts

MODEL = two_segment()
SHORT = Prts(stages=6)
"""14.56 s: enough to reach every line from 0.07 Hz in little time."""


def still(cycles: int = 6) -> Protocol:
    return Protocol(waveform=SHORT, amplitudes=(5.0,), cycles=cycles, noise=SILENT)


@pytest.mark.parametrize("name", ["none", *library.LIBRARY.linear])
def test_time_domain_and_closed_form_agree_with_every_effect(name: str) -> None:
    names = [] if name == "none" else [name]
    theta, sizes = draw_case(MODEL, names, np.random.default_rng(3), spread=0.05)
    recording = simulate_recording(still(), theta, np.random.default_rng(1), effects=names, sizes=sizes)
    model, full = body_with_effects(MODEL, theta, names, sizes)
    lines = measure(recording, discard=4)
    expected = frf(model, full, lines.f)
    assert np.abs(lines.y / expected - 1).max() < 1e-3


def test_platform_translation_agrees_with_the_closed_form() -> None:
    model = two_segment(stimulus="platform_translation")
    protocol = Protocol("platform_translation", SHORT, (0.05,), 6, noise=SILENT)
    lines = measure(simulate_recording(protocol, model.truth, np.random.default_rng(0)), fmax=4.0, discard=3)
    np.testing.assert_allclose(lines.y, frf(model, model.truth, lines.f), rtol=3e-3)


@pytest.mark.parametrize("name", [e.name for e in library.LIBRARY.values() if e.rule])
def test_a_rule_vanishes_at_its_null_and_shows_at_its_published_size(name: str) -> None:
    declared = library.effect(name)
    protocol = Protocol(waveform=SHORT, amplitudes=(3.0, 5.0), cycles=3)
    base = simulate_recording(protocol, MODEL.truth, np.random.default_rng(1))
    for size, same in ((0.0, True), (declared.size.published[1], False)):
        other = simulate_recording(
            protocol, MODEL.truth, np.random.default_rng(1), effects=[name], sizes={declared.size.name: size}
        )
        change = max(np.abs(a.theta - b.theta).max() for a, b in zip(base.trials, other.trials, strict=True))
        assert change < 1e-12 if same else change > 1e-5


def test_a_made_recording_passes_every_check() -> None:
    for kind, amplitude in (
        ("ankle_torque", 5.0),
        ("hip_torque", 5.0),
        ("platform_translation", 0.05),
        ("surface_tilt", 0.01),
        ("visual_tilt", 0.02),
    ):
        for periodic in (True, False):
            protocol = Protocol(kind, SHORT, (amplitude, amplitude), 6, periodic)
            recording = simulate_recording(protocol, two_segment(stimulus=kind).truth, np.random.default_rng(2))
            assert (recording.period_s is not None) == periodic
            assert checked_recording(recording).recording.suspicions == ()


STIMULI_OF_A_STUDY = """
[study]
name = "tilts"
seed = 1
[stimulus]
kind = "surface_tilt"
stages = 4
state_s = 0.25
rate_hz = 60
convention = "peak_to_peak"
cycles = 3
[spectra]
points = "odd_lines"
[group.sequence]
realizations = 1
starts = 1
fmax = [2.0]
amplitude = [0.01, 0.02]
[group.lines]
realizations = 1
starts = 1
fmax = [2.0]
amplitude = [0.02]
stimulus.lines = {harmonic = [1, 5, 9, 21], weight = [2.0, 1.0, 1.0, 0.5], phase_deg = [0.0, 90.0, 20.0, 200.0]}
"""


def test_a_recording_has_the_stimulus_of_a_study_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study, out = tmp_path / "study.toml", tmp_path / "rec.nc"
    study.write_text(STIMULI_OF_A_STUDY)
    assert main(["simulate", "-o", str(out), "--stimulus-of", f"{study}:lines", "--noise", "0"]) == Exit.DONE
    recording = read_recording(out)
    (trial,) = recording.trials
    assert (recording.stimulus, recording.period_s, recording.rate_hz) == ("surface_tilt", 20.0, 60.0)
    assert np.ptp(trial.stimulus) == pytest.approx(0.02, rel=2e-3)  # between the samples of the smoothed motion
    lines = np.fft.rfft(trial.stimulus[:1200])
    lines[np.abs(lines) < 1e-9 * np.abs(lines).max()] = 0
    assert np.flatnonzero(lines).tolist() == [1, 5, 9, 21]
    amplitudes = np.abs(lines[[1, 5, 9, 21]]) * (1 + (np.array([1, 5, 9, 21]) / 20 / 6.0) ** 4)
    assert amplitudes / amplitudes[0] == pytest.approx([1.0, 0.5, 0.5, 0.25], rel=1e-6)
    assert measure(recording, fmax=2.0).f == pytest.approx([0.05, 0.25, 0.45, 1.05])
    assert main(["simulate", "-o", str(out), "--stimulus-of", str(study), "--cycles", "4"]) == Exit.DONE
    recording = read_recording(out)
    assert [np.ptp(t.stimulus) for t in recording.trials] == pytest.approx([0.01, 0.02], rel=1e-2)
    assert [t.stimulus.size for t in recording.trials] == [4800, 4800]
    capsys.readouterr()
    for words, message in (
        ((f"{study}:other",), "expected a group of sequence, lines, got 'other'"),
        ((str(study), "--rate", "100"), "--rate: expected none beside --stimulus-of"),
    ):
        assert message in refused("simulate", "-o", str(out), "--stimulus-of", *words)


def test_seeds_decide_everything_and_a_longer_recording_begins_with_the_shorter() -> None:
    protocol = Protocol(waveform=SHORT, amplitudes=(5.0,), cycles=3)
    two = Protocol(waveform=SHORT, amplitudes=(5.0, 5.0), cycles=3)
    one, again, more, other = (
        simulate_recording(p, MODEL.truth, np.random.default_rng(s))
        for p, s in ((protocol, 1), (protocol, 1), (two, 1), (protocol, 2))
    )
    np.testing.assert_array_equal(one.trials[0].theta, again.trials[0].theta)
    np.testing.assert_array_equal(one.trials[0].theta, more.trials[0].theta)
    assert np.abs(one.trials[0].theta - other.trials[0].theta).max() > 1e-4


def test_an_additional_torque_acts_on_the_side_of_the_stimulus() -> None:
    """A torque of 0.2 N m per N m of nothing: feeding back stiffness by iteration equals stiffness in the table."""
    stiff = MODEL.with_values({"Kpas1": 166.0})
    protocol = still(3)
    by_table = simulate_recording(protocol, stiff.truth, np.random.default_rng(0))
    by_torque = simulate_recording(
        protocol,
        MODEL.truth,
        np.random.default_rng(0),
        torque=lambda sway, _: np.column_stack([0 * sway.angle[:, 0], -20.0 * sway.angle[:, 0]]),
    )
    # The torque is linear between samples, the table's stiffness is not.
    difference = np.abs(by_table.trials[0].theta - by_torque.trials[0].theta).max()
    assert difference < 2e-4 * np.abs(by_table.trials[0].theta).max()


@pytest.mark.parametrize("name", OUT_OF_LIBRARY)
def test_every_effect_outside_the_library_is_stable_and_differs_from_the_model(name: str) -> None:
    protocol = Protocol(waveform=SHORT, amplitudes=(5.0,), cycles=3)
    base = simulate_recording(protocol, MODEL.truth, np.random.default_rng(1))
    for size in OUT_OF_LIBRARY[name].size:
        recording = simulate_out_of_library(name, size, protocol, MODEL.truth, np.random.default_rng(1))
        change = np.abs(recording.trials[0].theta - base.trials[0].theta).max()
        assert 1e-5 < change < 0.2


def test_out_of_library_effects_are_not_in_the_library_and_the_library_does_not_know_them() -> None:
    assert not set(OUT_OF_LIBRARY) & set(library.LIBRARY)
    assert len(OUT_OF_LIBRARY) >= 6
    package = Path(library.__file__).parents[1]
    users = [p.relative_to(package) for p in package.rglob("*.py") if "out_of_library" in p.read_text()]
    assert all("challenge" in str(p) for p in users)


def test_what_cannot_stand_is_refused_in_one_line() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match=r"closed loop is unstable with Tact = 0\.1"):
        simulate_recording(still(), MODEL.truth, rng, effects=["activation_dynamics"], sizes={"Tact": 0.1})
    with pytest.raises(InputError, match="expected its size m_head in kg"):
        simulate_recording(still(), MODEL.truth, rng, effects=["head_mode"])
    with pytest.raises(InputError, match="size 'Tact': expected one of m_head, f_head"):
        simulate_recording(still(), MODEL.truth, rng, effects=["head_mode"], sizes={"Tact": 0.1})
    with pytest.raises(InputError, match="the body falls; reduce the size of torque_saturation"):
        simulate_recording(still(), MODEL.truth, rng, effects=["torque_saturation"], sizes={"saturation": 0.5})


def test_drawn_cases_stand_and_stay_near_the_nominal_body() -> None:
    for name in library.LIBRARY.linear:
        theta, sizes = draw_case(MODEL, [name], np.random.default_rng(5))
        assert set(sizes) == set(library.effect(name).parameters)
        gains = [k for k, n in enumerate(MODEL.names) if n not in MODEL.delays]
        assert np.abs(theta[gains] / MODEL.truth[gains] - 1).max() <= 0.1 + 1e-12
        body_with_effects(MODEL, theta, [name], sizes)


def test_the_command_writes_a_recording_that_can_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    simulate.add_arguments(parser)
    words = "--effect head_mode --effect stimulus_gain=0.1 --amplitude 3 5 --cycles 3 --rate 100 --seed 4"
    out = tmp_path / "rec.nc"
    assert simulate.main(parser.parse_args(["-o", str(out), *words.split()])) == 0
    assert "eps_stim = 0.1" in capsys.readouterr().out
    recording = read_recording(out)
    assert isinstance(recording, Recording)
    assert [round(a, 6) for a in recording.amplitudes] == [3.0, 5.0]
    with pytest.raises(InputError, match="expected NAME=NUMBER"):
        simulate.main(parser.parse_args(["-o", str(out), "--effect", "stimulus_gain=much"]))
    with pytest.raises(InputError, match="unknown K99"):
        simulate.main(parser.parse_args(["-o", str(out), "--parameter", "K99=1"]))


NONSENSE = {
    "--rate": ("1e300",),
    "--noise": ("1e300", "-1"),
    "--amplitude": ("5 1e308", "1e-300"),
    "--cycles": ("1000000000", "5000"),
    "--seed": ("-1",),
    "--parameter": ("K11=1e308", "Td1=1e308", "Td1=-1"),
    "--effect": [f"{name}={size}" for name in library.LIBRARY for size in ("1e-300", "1e300", "1e308", "nan", "inf")],
}


@pytest.mark.parametrize(("option", "value"), [(option, v) for option, values in NONSENSE.items() for v in values])
def test_a_number_no_body_has_is_refused_in_one_line(option: str, value: str, tmp_path: Path) -> None:
    out = tmp_path / "rec.nc"
    said = refused("simulate", "-o", str(out), option, *value.split())
    assert said.startswith(f"mcstudy: {option}")
    assert "expected" in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_a_time_constant_far_below_a_sample_is_refused() -> None:
    with pytest.raises(InputError, match="times too fast for 200 Hz; expected at most 1000"):
        simulate_recording(
            still(), MODEL.truth, np.random.default_rng(1), effects=["stimulus_lag"], sizes={"tau_stim": 1e-9}
        )


def simulated(out: Path, *words: str) -> int:
    parser = argparse.ArgumentParser()
    simulate.add_arguments(parser)
    return simulate.main(parser.parse_args(["-o", str(out), "--cycles", "3", "--rate", "50", *words]))


@pytest.mark.parametrize("name", ["activation_dynamics", "torque_saturation"])
def test_a_drawn_size_is_made_smaller_until_the_body_stands_and_the_command_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The nominal body stands with a fifth of the published activation dynamics; one with short delays with more."""
    assert simulated(tmp_path / "rec.nc", "--effect", name) == 0
    assert "of its usual range, because the body is unstable with larger sizes" in capsys.readouterr().out
    assert isinstance(read_recording(tmp_path / "rec.nc"), Recording)


def test_a_drawn_size_that_stands_is_within_its_published_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert simulated(tmp_path / "rec.nc", "--effect", "stimulus_lag") == 0
    said = capsys.readouterr().out
    low, high = library.effect("stimulus_lag").size.published
    assert low <= float(said.split("tau_stim = ")[1]) <= high


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--parameter", "K11=300", "--effect", "stimulus_lag"], "unstable with every size that was tried"),
        (["--effect", "activation_dynamics=0.03"], "closed loop is unstable with Tact"),
    ],
)
def test_the_command_refuses_an_absurd_number_in_one_line(tmp_path: Path, words: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        simulated(tmp_path / "rec.nc", *words)
    assert "\n" not in str(caught.value)


def test_a_recording_is_not_written_into_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent/rec\.nc: cannot be written: .*absent is not a folder"):
        simulated(tmp_path / "absent" / "rec.nc")
