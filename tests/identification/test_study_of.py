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
from mcstudy.identification.study_of import noise_of
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import sway_psd


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
        for theta, noise in ((nominal.truth, truth), (fitted.theta, noise_of(fitted)))
    )
    np.testing.assert_allclose(study / true, 1, atol=0.2)


def test_the_study_scatters_as_the_intervals_say(fitted: mc.FitResult, tmp_path: Path) -> None:
    """Within a factor of 2, as a geometric mean over quantities; uniform starts gave 10, in wrong minima."""
    study = mc.study_from(fitted, realizations=8, starts=2)
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


def test_an_experiment_that_a_study_cannot_express_is_refused(fitted: mc.FitResult) -> None:
    lines = replace(fitted.lines, power=fitted.lines.power * np.linspace(1, 3, len(fitted.lines)))
    cases = (
        (replace(fitted, recording=None), "expected a recording with a periodic stimulus"),
        (replace(fitted, lines=lines), "expected a pseudorandom ternary sequence"),
        (replace(fitted, method={**fitted.method, "effects": ["x"]}), "effects: expected none"),
    )
    for given, said in cases:
        with pytest.raises(InputError, match=said):
            mc.study_from(given)
