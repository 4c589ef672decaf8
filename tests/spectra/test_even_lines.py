"""The noise covariance from even lines: unbiased, with the degrees of freedom it states."""

import numpy as np
import pytest

from mcstudy.errors import InputError
from mcstudy.spectra import bands, periods
from mcstudy.spectra.even_lines import EvenLineCovariance
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import NoiseSway, sway_psd

MODEL, NOISE = two_segment(), SensorNoise()
LINES = bands.odd_lines(8.0).lines
TOP = 420


def complex_normal(rng, *shape):
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


@pytest.fixture(scope="module")
def density():
    """Covariance of one line of sway noise, up to scale, at harmonics 0 ... TOP."""
    out = np.zeros((TOP + 1, 2, 2), dtype=complex)
    out[1:] = sway_psd(MODEL, MODEL.truth, NOISE, np.arange(1, TOP + 1) / 43.72)
    return out


@pytest.fixture(scope="module")
def estimates(density):
    """300 estimates from independent lines, expressed in units of the true covariance (the identity if unbiased)."""
    estimator, rng = EvenLineCovariance(LINES, TOP), np.random.default_rng(1)
    factor = np.zeros_like(density)
    factor[1:] = np.linalg.cholesky(density[1:])
    whitener = np.linalg.inv(factor[LINES])
    out = []
    for _ in range(300):
        noise = np.einsum("kij,kj->ki", factor, complex_normal(rng, TOP + 1, 2))
        out.append(whitener @ estimator(noise) @ whitener.conj().swapaxes(1, 2))
    return np.array(out)


def test_the_covariance_is_unbiased_in_every_direction(estimates):
    """Within 25 % below line 20, where it bends most, and 15 % above, in both eigen-directions; they differ by 30 dB.

    A plain average over as many lines is off by a factor of two to five in the weak direction.
    """
    eigenvalues = np.linalg.eigvalsh(estimates.mean(axis=0))
    low = LINES < 20
    assert eigenvalues[low].min() > 0.75
    assert eigenvalues[low].max() < 1.3
    smooth = [eigenvalues[~low][i : i + 10].mean(axis=0) for i in range(0, 165, 10)]
    assert np.min(smooth) > 0.85
    assert np.max(smooth) < 1.15


def test_the_stated_degrees_of_freedom_are_those_of_the_scatter(estimates):
    """A mean over m independent lines of unit exponential power has variance 1/m."""
    stated = EvenLineCovariance(LINES, TOP).dof
    power = np.einsum("tnii->tn", estimates).real / 2
    found = 0.5 / (power.var(axis=0) / power.mean(axis=0) ** 2)  # two independent directions
    assert stated[0] < 5 < stated[-1]
    assert np.median(found[20:] / stated[20:]) == pytest.approx(1.0, abs=0.3)


def test_on_simulated_sway_the_estimate_is_the_variance_of_odd_lines():
    """Ramp removed, mean of cycles 2 to 6: estimated over true variance within 10 % in every third of the lines."""
    sampler = NoiseSway(MODEL, MODEL.truth, NOISE, 6 * 8744, 200.0)
    estimator, rng = EvenLineCovariance(LINES, 4372), np.random.default_rng(2)
    estimated, actual, runs = 0.0, 0.0, 80
    for _ in range(runs):
        c = periods.ramp_removed(sampler.sample(rng), 8744, 1)
        estimated = estimated + np.einsum("nii->ni", estimator(c)).real / runs
        actual = actual + np.abs(c[LINES]) ** 2 / runs
    truth = np.einsum("nii->ni", sway_psd(MODEL, MODEL.truth, NOISE, LINES / 43.72)).real / (2 * 5 * 43.72)
    for part in np.array_split(np.arange(LINES.size), 3):
        assert (estimated / truth)[part].mean(axis=0) == pytest.approx([1, 1], abs=0.1)
        assert (estimated[part] / actual[part]).mean(axis=0) == pytest.approx([1, 1], abs=0.12)


def test_the_scatter_between_cycles_misstates_the_variance_of_their_mean():
    """By several times above 4 Hz, when the DFT is raw: why the even lines are used."""
    sampler, rng = NoiseSway(MODEL, MODEL.truth, NOISE, 6 * 8744, 200.0), np.random.default_rng(3)
    scatter, actual, k = 0.0, 0.0, np.arange(301, 350)
    for _ in range(40):
        x = sampler.sample(rng)
        each = np.stack([periods.coefficients(cycle)[k] for cycle in periods.cut(x, 8744, 1)])
        scatter = scatter + each.var(axis=0, ddof=1) / 5
        actual = actual + np.abs(each.mean(axis=0)) ** 2
    assert (scatter / actual).mean(axis=0).min() > 3


def test_trials_are_pooled(density):
    """T trials: the covariance of their mean, with T times the degrees of freedom."""
    estimator, rng = EvenLineCovariance(LINES, TOP), np.random.default_rng(4)
    factor = np.zeros_like(density)
    factor[1:] = np.linalg.cholesky(density[1:])
    trials = np.einsum("kij,tkj->tki", factor, complex_normal(rng, 16, TOP + 1, 2))
    ratio = np.einsum("nii->ni", estimator(trials)).real / np.einsum("nii->ni", density[LINES]).real
    assert ratio.mean() == pytest.approx(1 / 16, rel=0.1)
    assert np.abs(np.log(16 * ratio)).max() < 0.7
    assert estimator(trials[:1]) == pytest.approx(estimator(trials[0]), rel=1e-12)


def test_few_lines_use_a_shorter_regression():
    estimator, rng = EvenLineCovariance(np.array([1, 3, 5, 7, 9]), 24), np.random.default_rng(5)
    assert estimator.order < 3
    pink = 1 / np.sqrt(np.maximum(np.arange(25), 1))[:, None]
    mean = np.mean([estimator(pink * complex_normal(rng, 25, 2)) for _ in range(500)], axis=0)
    ratio = np.einsum("nii->ni", mean).real * np.arange(1, 10, 2)[:, None]
    assert ratio == pytest.approx(np.ones((5, 2)), abs=0.25)


def test_a_silent_angle_has_no_covariance():
    noise = complex_normal(np.random.default_rng(6), TOP + 1, 2) * [1.0, 0.0]
    covariance = EvenLineCovariance(LINES, TOP)(noise)
    assert (covariance[:, 1] == 0).all()
    assert (covariance[:, 0, 0].real > 0).all()


@pytest.mark.parametrize(
    ("lines", "top", "says"),
    [([2, 3], 100, "odd"), ([], 100, "odd"), ([-1], 100, "odd"), ([101], 100, "101"), ([1], 7, "four")],
)
def test_unusable_lines_are_refused(lines, top, says):
    with pytest.raises(InputError, match=says):
        EvenLineCovariance(np.array(lines, dtype=int), top)
