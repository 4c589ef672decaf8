"""From a fit to a study of the same experiment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.identification.study_noise import noise_of
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.study.measure import stimulus as stimulus_of_group


@pytest.fixture(scope="module")
def recording() -> mc.Recording:
    return mc.simulate(seed=5, cycles=6, rate_hz=100.0, noise=1.5)


@pytest.fixture(scope="module")
def fitted(recording: mc.Recording) -> mc.FitResult:
    return mc.fit(recording, fmax=3.1)


def test_the_study_is_the_experiment_of_the_recording(fitted: mc.FitResult) -> None:
    (group,) = mc.study_from(fitted).groups.values()
    assert (group.stimulus.stages, group.stimulus.state_s, group.stimulus.rate_hz) == (7, 0.02, 100.0)
    assert group.stimulus.cycles - group.stimulus.discard == len(fitted.lines.repeats) == 10
    assert group.amplitude == (5.0,)
    assert group.fmax == (3.1,)
    assert list(group.model.truth.values()) == pytest.approx(list(fitted.theta))


def test_the_noise_of_the_study_evokes_the_sway_that_was_measured(fitted: mc.FitResult) -> None:
    """Against the truth of the simulation: RMS of the sway noise at the lines, within 20 %."""
    density = np.array(SensorNoise().psd_deg2_hz) * 1.5**2
    truth = SensorNoise((float(density[0]), float(density[1])))
    model, f = fitted.model, fitted.lines.f
    nominal = mc.simulate(seed=0, cycles=3, rate_hz=50.0).base_model()
    true, study = (
        np.sqrt(np.einsum("nii->i", sway_psd(model, theta, noise, f)).real)
        for theta, noise in ((nominal.truth, truth), (fitted.theta, noise_of(fitted).sensors))
    )
    np.testing.assert_allclose(study / true, 1, atol=0.2)


def test_the_study_scatters_as_the_intervals_say(fitted: mc.FitResult, tmp_path: Path) -> None:
    """Within a factor of 2, as a geometric mean over quantities; uniform starts gave 10, in wrong minima."""
    study = mc.study_from(fitted, realizations=8, starts=6)
    group = mc.run(study, tmp_path / "s.zarr", workers=1)["experiment"].isel(amplitude=0, fmax=0)
    best = group.estimate.isel(start=group.cost.argmin("start")).load()
    known = [e for e in fitted.estimates if e.verdict == "identifiable" and e.name in fitted.model.names]
    ratio = [float(best.sel(parameter=e.name).std(ddof=1)) / ((e.high - e.low) / (2 * 1.96)) for e in known]
    assert len(ratio) >= 6
    assert 0.5 < np.exp(np.mean(np.log(ratio))) < 2


def test_the_command_writes_a_study_that_can_be_planned(
    recording: mc.Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "r.nc", tmp_path / "mine.toml"
    mc.write_recording(recording, file)
    words = ["study-from", str(file), "--fmax", "3.1", "-o", str(out), "--realizations", "3", "--starts", "2"]
    assert main(words) == Exit.DONE
    said = capsys.readouterr().out
    assert "Not determined by the recording" in said
    study = mc.read_study(out)
    assert (study.study.name, study.fits) == ("mine", 6)
    assert main([*words[:5], str(tmp_path / "1.txt")]) == Exit.BAD_INPUT


@pytest.mark.parametrize(("kind", "amplitude"), [("platform_translation", 0.01), ("surface_tilt", 0.02)])
def test_a_stimulus_that_is_no_sequence_is_given_by_its_lines(kind: str, amplitude: float) -> None:
    """The waveform of the study at the lines, against the recorded samples of one cycle."""
    recording = mc.simulate(stimulus=kind, amplitude=amplitude, seed=3, cycles=4, rate_hz=50.0)
    fitted = mc.fit(recording, fmax=3.1)
    smooth = replace(fitted.lines, power=fitted.lines.power * np.linspace(1, 1.3, len(fitted.lines)))
    (group,) = mc.study_from(replace(fitted, lines=smooth)).groups.values()
    lines = group.stimulus.lines
    n = recording.period
    assert n is not None
    recorded = np.fft.rfft(recording.trials[0].stimulus[n : 2 * n])[list(lines.harmonic)] / n
    mine = stimulus_of_group(group, group.amplitude[0])
    assert mine.period_s == pytest.approx(recording.period_s, rel=1e-12)
    found = mine.coefficients()[list(lines.harmonic)]
    low = np.array(lines.harmonic) <= 3.1 * mine.period_s
    np.testing.assert_array_equal(np.array(lines.harmonic)[low], fitted.lines.harmonic)
    np.testing.assert_allclose(found[low], recorded[low], atol=0.03 * np.abs(recorded[low]).max())
    assert set(group.model.truth) == set(fitted.model.names)


def test_an_experiment_that_a_study_cannot_express_is_refused(fitted: mc.FitResult) -> None:
    wild = replace(fitted.lines, noise=replace(fitted.lines.noise, C=fitted.lines.noise.C * [[1e-6, 1e-3], [1e-3, 1]]))
    recording = fitted.recording
    assert isinstance(recording, mc.Recording)
    hip = replace(recording, stimulus="hip_torque")
    even = [replace(t, stimulus=t.stimulus + 0.1 * np.abs(t.stimulus)) for t in recording.trials]
    cases = (
        (replace(fitted, recording=None), "expected a recording with a periodic stimulus"),
        (replace(fitted, recording=JointRecording((recording, hip))), "expected one stimulus, .* ankle_torque and hip"),
        (replace(fitted, lines=wild), "no sensor noise evokes the measured sway"),
        (
            replace(
                fitted,
                recording=replace(recording, trials=tuple(even)),
                lines=replace(fitted.lines, power=fitted.lines.power * np.linspace(1, 3, len(fitted.lines))),
            ),
            "odd harmonics of its period only",
        ),
        (replace(fitted, method=replace(fitted.method, effects=("x",))), "effects: expected none"),
    )
    for given, said in cases:
        with pytest.raises(InputError, match=said):
            mc.study_from(given)


def test_the_example_prints_how_far_noise_is_explained(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "pipelines" / "validation")
    import study_noise

    monkeypatch.setattr(study_noise, "AMPLITUDES", {"surface_tilt": 0.02})
    monkeypatch.setattr("sys.argv", ["study_noise.py", "--seeds", "201"])
    study_noise.main()
    said = capsys.readouterr().out
    assert "seed 201, body 0, surface_tilt: factor 1.04, largest error 0.07" in said
    assert "0 of 2 recordings refused" in said
