"""Properties of stimulus and spectra that hold for any input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcstudy.spectra import bands, periods
from mcstudy.spectra.even_lines import EvenLineCovariance
from mcstudy.stance.noise import record, white_coefficients
from mcstudy.stance.stimulus import Prts

seeds = st.integers(0, 2**32 - 1)


@given(
    stages=st.integers(2, 6),
    held=st.integers(1, 5),
    amplitude=st.floats(1e-3, 1e3),
    convention=st.sampled_from(["peak", "peak_to_peak"]),
)
@settings(max_examples=40, deadline=None)
def test_every_prts_is_half_wave_odd_with_the_asked_amplitude(stages, held, amplitude, convention):
    prts = Prts(stages=stages, state_s=held / 100, rate_hz=100.0, amplitude=amplitude, convention=convention)
    x = prts.waveform()
    half = prts.samples // 2
    assert x.size == prts.samples == held * (3**stages - 1)
    assert x[:half] == pytest.approx(-x[half:], abs=1e-9 * amplitude)
    size = np.abs(x).max() if convention == "peak" else np.ptp(x)
    assert size == pytest.approx(amplitude, rel=1e-12)


@given(seed=seeds, n=st.integers(4, 300))
@settings(max_examples=50, deadline=None)
def test_coefficients_and_record_are_inverse(seed, n):
    c = white_coefficients(np.random.default_rng(seed), n)
    assert periods.coefficients(record(c, n)) == pytest.approx(c, abs=1e-13)


@given(seed=seeds, period=st.integers(4, 60), cycles=st.integers(1, 4), discard=st.integers(1, 2))
@settings(max_examples=50, deadline=None)
def test_ramp_removal_ignores_any_ramp_and_leaves_periodic_signals_alone(seed, period, cycles, discard):
    rng = np.random.default_rng(seed)
    n = (cycles + discard) * period
    x = rng.standard_normal((n, 2))
    ramp = np.arange(n)[:, None] * rng.standard_normal(2)
    plain = periods.ramp_removed(x, period, discard)
    assert periods.ramp_removed(x + ramp, period, discard)[1:] == pytest.approx(plain[1:], abs=1e-9)
    wave = np.tile(rng.standard_normal((period, 2)), (cycles + discard, 1))
    assert periods.ramp_removed(wave, period, discard) == pytest.approx(periods.raw(wave, period, discard), abs=1e-12)


@given(seed=seeds, scale=st.floats(1e-6, 1e6))
@settings(max_examples=30, deadline=None)
def test_the_line_covariance_is_hermitian_positive_and_scales(seed, scale):
    rng = np.random.default_rng(seed)
    c = white_coefficients(rng, 200)
    estimator = EvenLineCovariance(np.arange(1, 60, 2), 100)
    covariance = estimator(c)
    assert np.array_equal(covariance, covariance.conj().swapaxes(1, 2))
    assert np.linalg.eigvalsh(covariance).min() > 0
    gains = np.array([scale, 1.0])
    assert estimator(c * gains) == pytest.approx(covariance * gains[:, None] * gains, rel=1e-6, abs=1e-9 * scale)


@given(seed=seeds, fmax=st.floats(0.05, 9.0))
@settings(max_examples=30, deadline=None)
def test_band_means_are_linear_keep_constants_and_cut_is_a_prefix(seed, fmax):
    points = bands.published()
    rng = np.random.default_rng(seed)
    a, b = (rng.standard_normal((points.lines.size, 2)) for _ in range(2))
    assert points.average(a + 2 * b) == pytest.approx(points.average(a) + 2 * points.average(b), abs=1e-12)
    assert points.average(np.ones_like(a)) == pytest.approx(np.ones((len(points), 2)))
    kept = points.below(fmax)
    assert np.array_equal(kept.f, points.f[: len(kept)])
