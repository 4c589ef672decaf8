"""Periods, their coefficients, and the ramp."""

import numpy as np
import pytest

from mcstudy.errors import RecordingError
from mcstudy.spectra import periods
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import NoiseSway, sway_psd

PERIOD, RATE = 8744, 200.0


def test_periods_are_cut_in_order_and_the_first_dropped():
    x = np.arange(25.0)
    assert periods.cut(x, 8, 1).tolist() == [list(range(8, 16)), list(range(16, 24))]
    assert periods.mean_period(x, 8, 1).tolist() == list(np.arange(12.0, 20.0))


@pytest.mark.parametrize(("n", "period", "discard"), [(15, 8, 1), (7, 8, 0), (16, 8, -1), (16, 1, 0)])
def test_a_record_without_a_whole_period_left_is_refused(n, period, discard):
    with pytest.raises(RecordingError, match="periods"):
        periods.cut(np.zeros(n), period, discard)


def test_coefficient_convention():
    """A cosine of amplitude a at harmonic k has coefficient a/2 there, e^(i phase) included."""
    n = np.arange(100)
    x = 3.0 * np.cos(2 * np.pi * 4 * n / 100 + 0.7) + 1.5
    c = periods.coefficients(x)
    assert c[4] == pytest.approx(1.5 * np.exp(0.7j))
    assert c[0] == pytest.approx(1.5)
    assert np.abs(np.delete(c, [0, 4])).max() < 1e-14


@pytest.mark.parametrize("discard", [0, 1, 2])
def test_removing_the_ramp_is_subtracting_the_ramp(discard):
    """Coefficients through increments equal those of the mean period minus the straight line between its ends."""
    period, cycles = 50, 3
    x = np.cumsum(np.random.default_rng(1).standard_normal(((cycles + discard) * period + 1, 2)), axis=0)
    start, stop = discard * period, (discard + cycles) * period
    d = x[stop] - x[start] if discard == 0 else x[stop - 1] - x[start - 1]
    line = np.arange(period)[:, None] / period * d / cycles
    expected = periods.coefficients(periods.mean_period(x, period, discard) - line)
    assert periods.ramp_removed(x, period, discard)[1:] == pytest.approx(expected[1:], rel=1e-10, abs=1e-13)
    assert periods.ramp_removed(x, period, discard)[0] == pytest.approx(periods.raw(x, period, discard)[0])


def test_removing_the_ramp_needs_one_sample_more():
    with pytest.raises(RecordingError, match="discard one period"):
        periods.ramp_removed(np.zeros(100), 50, 0)
    assert (periods.ramp_removed(np.zeros(101), 50, 0) == 0).all()


def test_raw_spectra_leak_at_high_frequency_and_ramp_removed_ones_do_not():
    """Variance over true density in the mean of cycles 2 to 6: raw it is tens at 8 Hz, without the ramp it is 1."""
    model, noise = two_segment(), SensorNoise()
    sampler, rng, runs = NoiseSway(model, model.truth, noise, 6 * PERIOD, RATE), np.random.default_rng(2), 60
    records = [sampler.sample(rng) for _ in range(runs)]
    # groups of ten neighbouring lines, to average over
    groups = {hz: np.arange(round(hz * 43.72) - 5, round(hz * 43.72) + 5) for hz in (0.3, 4.0, 8.0)}

    def ratio(spectrum, k):
        power = np.mean([np.abs(spectrum(x, PERIOD, 1)[k]) ** 2 for x in records], axis=0)
        density = sway_psd(model, model.truth, noise, k / 43.72) / (2 * 5 * 43.72)
        return (power / np.einsum("nii->ni", density).real).mean(axis=0)

    raw = {hz: ratio(periods.raw, k) for hz, k in groups.items()}
    assert raw[0.3] == pytest.approx([1.0, 1.0], abs=0.25)
    assert raw[4.0][0] > 1.8
    assert raw[8.0][0] > 25
    assert raw[8.0][1] > 2
    for k in groups.values():
        assert ratio(periods.ramp_removed, k) == pytest.approx([1.0, 1.0], abs=0.25)


def test_raw_leakage_is_the_same_number_at_neighbouring_lines():
    model = two_segment()
    sampler = NoiseSway(model, model.truth, SensorNoise(), 6 * PERIOD, RATE)
    rng = np.random.default_rng(3)
    raw, removed = [], []
    for _ in range(60):
        x = sampler.sample(rng)
        raw.append(periods.raw(x, PERIOD, 1)[[345, 350], 0])
        removed.append(periods.ramp_removed(x, PERIOD, 1)[[345, 350], 0])

    def coherence(c):
        c = np.array(c)
        return abs(np.vdot(c[:, 0], c[:, 1])) / np.linalg.norm(c[:, 0]) / np.linalg.norm(c[:, 1])

    assert coherence(raw) > 0.9
    assert coherence(removed) < 0.4
