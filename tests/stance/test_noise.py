"""Sensor noise: its density, its convention, its records."""

import numpy as np
import pytest
from scipy.signal import periodogram, welch

from mcstudy.errors import InputError
from mcstudy.stance.noise import SensorNoise, record, record_frequencies, white_coefficients

RATE = 50.0


def test_the_density_is_given_at_half_a_hertz_after_the_filter():
    psd = SensorNoise().psd(np.array([0.5])) * (180 / np.pi) ** 2
    assert psd[0] == pytest.approx([4e-4, 7e-5])


def test_pink_below_the_corner_and_third_power_above():
    psd = SensorNoise().psd(np.array([0.001, 0.002, 10.0, 20.0]))
    assert psd[0] / psd[1] == pytest.approx(2.0, rel=1e-3)
    assert psd[2] / psd[3] == pytest.approx(8.0, rel=1e-3)
    corner = SensorNoise().psd(np.array([0.15, 1e-6]))
    assert corner[0] * 0.15 == pytest.approx(corner[1] * 1e-6 / 2)


def test_density_is_one_sided_periodogram():
    """The mean periodogram of whole records is the density, line by line; DC is zero, Nyquist counts half."""
    noise, rng, n = SensorNoise(), np.random.default_rng(1), 600
    runs = 400
    mean = 0.0
    for _ in range(runs):
        f, p = periodogram(noise.sample(rng, n, RATE), RATE, axis=0, detrend=False, window="boxcar")
        mean = mean + p / runs
    ratio = mean[1:-1] / noise.psd(f[1:-1])
    assert np.abs(ratio - 1).max() < 6 / np.sqrt(runs)
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert mean[0] == pytest.approx(0.0, abs=1e-20)
    assert mean[-1] / noise.psd(f[-1:])[0] == pytest.approx([0.5, 0.5], rel=6 * np.sqrt(2 / runs))


def test_density_is_one_sided_welch():
    noise = SensorNoise()
    x = noise.sample(np.random.default_rng(2), 200_000, RATE)
    f, p = welch(x, RATE, nperseg=5000, axis=0)
    band = (f > 0.05) & (f < 15)
    ratio = p[band] / noise.psd(f[band])
    assert np.exp(np.log(ratio).mean(axis=0)) == pytest.approx([1.0, 1.0], abs=0.05)


def test_variance_is_the_integral_of_the_density():
    noise, n = SensorNoise(), 5000
    df = RATE / n
    expected = noise.psd(record_frequencies(n, RATE)).sum(axis=0) * df
    rng = np.random.default_rng(3)
    variance = np.mean([noise.sample(rng, n, RATE).var(axis=0) for _ in range(300)], axis=0)
    assert variance == pytest.approx(expected, rel=0.1)


def test_the_two_sources_are_independent():
    rng, noise = np.random.default_rng(4), SensorNoise()
    c = np.stack([noise.coefficients(rng, 400, RATE) for _ in range(300)]) / noise.coefficient_scale(400, RATE).clip(
        1e-30
    )
    cross = (c[:, 1:, 0] * c[:, 1:, 1].conj()).mean()
    assert abs(cross) < 5 / np.sqrt(300 * 200)
    pseudo = (c[:, 1:-1] ** 2).mean()
    assert abs(pseudo) < 5 / np.sqrt(300 * 200)


@pytest.mark.parametrize("n", [12, 13, 2186])
def test_a_record_and_its_coefficients_are_one_thing(n):
    c = white_coefficients(np.random.default_rng(5), n)
    x = record(c, n)
    assert x.shape == (n, 2)
    assert np.fft.rfft(x, axis=0) / n == pytest.approx(c, abs=1e-14)


def test_a_seed_fixes_the_record():
    first, again = (SensorNoise().sample(np.random.default_rng(7), 100, RATE) for _ in range(2))
    assert np.array_equal(first, again)


@pytest.mark.parametrize(
    ("field", "value"),
    [("psd_deg2_hz", ()), ("psd_deg2_hz", (-1.0, 1.0)), ("corner_hz", 0.0), ("reference_hz", -1)],
)
def test_an_unusable_field_is_named(field, value):
    with pytest.raises(InputError, match=field):
        SensorNoise(**{field: value})
