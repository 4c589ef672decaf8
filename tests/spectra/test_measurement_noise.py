"""Noise of the recording itself: outside the loop, correlated between outputs, in every covariance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mcstudy.errors import DesignError, InputError
from mcstudy.models.catalogue import read_model
from mcstudy.spectra import periods
from mcstudy.spectra.bands import odd_lines
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.spectra.frf_law import frf_law
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model, Output, OutputTerm
from mcstudy.stance.information import cramer_rao, expected_line_covariance
from mcstudy.stance.noise import MeasurementNoise, SensorNoise
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stance.stimulus import Prts
from mcstudy.study.design import Study
from mcstudy.study.study_file import parse_study

DEG = np.pi / 180.0
TRIAL = Prts(stages=4, state_s=0.05, rate_hz=100.0, amplitude=1.0)
BANDS = odd_lines(8.0, TRIAL.period_s)
CORRELATED = np.array([[1.0, -0.6, 0.2], [-0.6, 2.0, 0.3], [0.2, 0.3, 1.5]]) * (0.05 * DEG) ** 2


def measured(C: np.ndarray) -> MeasurementNoise:
    return MeasurementNoise(tuple(map(tuple, C.tolist())))


def three_outputs() -> Model:
    """Two segments of which three signals are recorded."""
    model = two_segment()
    first, second = model.angles
    outputs = (
        Output("lower", (OutputTerm(first),)),
        Output("upper", (OutputTerm(f"{first} + {second}"),)),
        Output("centre", (OutputTerm(first), OutputTerm(second, 0.22))),
    )
    return replace(model, outputs=outputs)


def ratios(sample: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Mean power of errors (R, L, Y) in each whitened direction: 1 where the covariance (L, Y, Y) is that of them."""
    white = np.einsum("lij,rlj->rli", np.linalg.inv(np.linalg.cholesky(C)), sample)
    return np.einsum("rli,rlj->ij", white, white.conj()) / white.shape[0] / white.shape[1]


@pytest.mark.parametrize("outputs", [2, 3])
def test_the_covariance_that_is_predicted_is_that_of_the_sample(outputs: int) -> None:
    """With correlated noise of both kinds, over all lines, in every direction and between directions."""
    model = two_segment() if outputs == 2 else three_outputs()
    noise, recorded = SensorNoise(), measured(CORRELATED[:outputs, :outputs])
    drive = TRIAL.coefficients()[BANDS.lines]

    def errors(cycles: int, discard: int, spectrum: periods.Spectrum) -> np.ndarray:
        subject = SpectralExperiment(
            model, model.truth, TRIAL, noise, BANDS, cycles, discard, spectrum, measured=recorded
        )
        seeds = range(3000)
        return np.array([subject.realization(np.random.default_rng(r)).coefficients for r in seeds]) / drive[:, None]

    whole = expected_line_covariance(
        model, model.truth, noise, BANDS.f, drive, 5 * TRIAL.period_s, recorded.psd(TRIAL.rate_hz)
    )
    # 48,000 numbers in each direction: a standard error of 0.5 %
    np.testing.assert_allclose(ratios(errors(5, 0, periods.raw), whole), np.eye(outputs), atol=0.02)
    law = frf_law(model, TRIAL, noise, BANDS, 6, 1, True, recorded)  # with leakage
    np.testing.assert_allclose(ratios(errors(6, 1, periods.ramp_removed), law.covariance), np.eye(outputs), atol=0.02)
    np.testing.assert_allclose(law.covariance, expected_line_covariance(
        model, model.truth, noise, BANDS.f, drive, 5 * TRIAL.period_s,
        recorded.psd_without_ramp(BANDS.f, 5 * TRIAL.period_s, TRIAL.rate_hz)), rtol=0.02,
        atol=0.02 * np.abs(law.covariance).max())  # fmt: skip
    # without it the covariance is far too small
    alone = expected_line_covariance(model, model.truth, noise, BANDS.f, drive, 5 * TRIAL.period_s)[:, :2, :2]
    assert np.einsum("lij,lji->l", np.linalg.inv(alone), whole[:, :2, :2]).real.mean() > 20


def test_white_noise_exceeds_the_sway_where_theory_says() -> None:
    """0.04 deg at 100 Hz, 3.2e-5 deg^2/Hz, above 2.8 Hz in the lower body and 3.2 Hz in the hip (stand-in body)."""
    model, noise = two_segment(), SensorNoise()
    S = measured(np.eye(2) * (0.04 * DEG) ** 2).psd(100.0)
    assert S[0, 0] / DEG**2 == pytest.approx(3.2e-5)
    f = np.arange(0.5, 8.0, 0.01)
    sway = np.einsum("nii->ni", sway_psd(model, model.truth, noise, f)).real
    above = [f[np.flatnonzero(sway[:, k] > S[k, k])[-1]] for k in (0, 1)]
    np.testing.assert_allclose(above, [2.8, 3.2], atol=0.1)


def test_a_record_has_the_covariance_and_is_white() -> None:
    records = np.array([measured(CORRELATED).sample(np.random.default_rng(r), 999) for r in range(200)])
    np.testing.assert_allclose(np.einsum("rni,rnj->ij", records, records) / records[..., 0].size, CORRELATED, rtol=0.06,
                               atol=0.02 * CORRELATED.max())  # fmt: skip
    assert abs((records[:, 1:, 0] * records[:, :-1, 0]).mean()) < 0.01 * CORRELATED[0, 0]


def test_uncertainty_grows_with_what_is_measured_worse() -> None:
    model, noise, drive = two_segment(), SensorNoise(), TRIAL.coefficients()[BANDS.lines]
    bounds = []
    for sd in (0.0, 0.02, 0.1):
        C = expected_line_covariance(
            model, model.truth, noise, BANDS.f, drive, 100.0, measured(np.eye(2) * (sd * DEG) ** 2).psd(100.0)
        )
        joint = np.zeros((BANDS.f.size, 2, BANDS.f.size, 2), dtype=complex)
        joint[np.arange(BANDS.f.size), :, np.arange(BANDS.f.size)] = C
        n = 2 * BANDS.f.size
        bounds.append(np.diag(cramer_rao(model, model.truth, BANDS.f, joint.reshape(n, n))))
    assert (bounds[1] > bounds[0]).all()
    assert (bounds[2] > 2 * bounds[1]).any()


def study(measurement: dict[str, Any] | None, **fields: Any) -> Study:
    noise = {} if measurement is None else {"measurement": measurement}
    stimulus = {"stages": 4, "state_s": 0.05, "rate_hz": 100.0}
    group = {"realizations": 1, "starts": 1, "fmax": [8.0], "amplitude": [1.0], "spectra": {"points": "odd_lines"}}
    return Study("a", seed=1).group("g", **(group | {"noise": noise, "stimulus": stimulus} | fields))


def test_a_study_file_states_it_in_degrees_and_without_it_nothing_changes() -> None:
    group = study({"sd": [0.05, 0.1], "correlation": [[1, -0.5], [-0.5, 1]]}).groups["g"]
    noise = group.measurement_noise
    assert noise is not None
    expected = np.array([[0.05**2, -0.5 * 0.05 * 0.1], [-0.5 * 0.05 * 0.1, 0.1**2]]) * DEG**2
    np.testing.assert_allclose(noise.matrix, expected)
    same = study({"covariance": [[0.0025, -0.0025], [-0.0025, 0.01]]}).groups["g"].measurement_noise
    np.testing.assert_allclose(same.matrix, expected)
    one = study({"sd": 0.05}).groups["g"].measurement_noise
    np.testing.assert_allclose(one.matrix, np.eye(2) * (0.05 * DEG) ** 2)
    whole = study({"sd": [0.05, 0.1]})
    assert parse_study(whole.to_toml()).fingerprint == whole.fingerprint
    assert study({}).fingerprint == study(None).fingerprint != whole.fingerprint
    assert "measurement" not in study(None).to_toml()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sd": [0.1, 0.1, 0.1]}, "noise.measurement.sd: expected 2 numbers, one for each output, or one for all"),
        ({"sd": 0.1, "correlation": [[1, 2], [2, 1]]}, "noise.measurement.correlation"),
        ({"sd": 0.1, "correlation": [[1, 0.1], [0.2, 1]]}, "noise.measurement.correlation: expected a symmetric"),
        ({"sd": 0.1, "correlation": [[0.5, 0], [0, 1]]}, "noise.measurement.correlation: expected 1 on the diagonal"),
        ({"covariance": [[1, 2], [2, 1]]}, "noise.measurement.covariance: expected a symmetric"),
        ({"covariance": [[1, 2]]}, "noise.measurement.covariance: expected 2 rows of 2 numbers, one for each output"),
        ({"covariance": [[1]], "sd": 1}, "noise.measurement: expected either covariance, or sd and correlation"),
        ({"sd": [-0.1, 1]}, "noise.measurement.sd"),
    ],
)  # fmt: skip
def test_what_is_no_noise_is_refused_in_one_line(given: dict[str, Any], message: str) -> None:
    with pytest.raises(DesignError, match=message.replace(".", r"\.")) as error:
        study(given)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError):
        measured(np.array([[1.0, 2.0], [2.0, 1.0]]))


@pytest.mark.parametrize("given", [{"sd": 0.1}, {"covariance": [[0.01]]}])
def test_a_model_of_one_joint_has_one_number(given: dict[str, Any]) -> None:
    elbow = read_model("elbow").model()
    group = study(given, model=elbow, fit={"cost": "ml"}, noise={"psd": 4e-4, "measurement": given}).groups["g"]
    assert group.measurement_noise is not None
    assert group.measurement_noise.matrix[0, 0] == pytest.approx((0.1 * DEG) ** 2)


def test_the_covariance_through_the_loop_is_refused_beside_it() -> None:
    fields = {"spectra": {"points": "odd_lines", "covariance": "through_loop"}, "fit": {"cost": "ml"}}
    study(None, **fields)
    with pytest.raises(DesignError, match=r"spectra.covariance: expected 'even_lines'"):
        study({"sd": 0.1}, **fields)
