"""The PRTS stimulus: period, symmetry, spectrum, amplitude conventions."""

import numpy as np
import pytest

from mcstudy.errors import InputError
from mcstudy.stance.stimulus import RECURRENCES, Prts, ternary_m_sequence


@pytest.mark.parametrize("stages", sorted(RECURRENCES))
def test_the_sequence_is_of_maximum_length(stages):
    """Every nonzero window of `stages` states occurs exactly once in a period of 3**n - 1, which then closes."""
    x = ternary_m_sequence(stages).astype(np.int64) % 3
    assert x.size == 3**stages - 1
    wrapped = np.concatenate([x, x[:stages]])
    windows = sum(3**i * wrapped[i : i + x.size] for i in range(stages))
    assert np.array_equal(np.sort(windows), np.arange(1, 3**stages))
    assert np.array_equal(sum(c * np.roll(x, lag) for lag, c in RECURRENCES[stages]) % 3, x)


def test_the_states_are_balanced():
    values, counts = np.unique(ternary_m_sequence(7), return_counts=True)
    assert values.tolist() == [-1, 0, 1]
    assert counts.tolist() == [729, 728, 729]


def test_the_default_is_the_papers_cycle():
    prts = Prts()
    assert (prts.states, prts.samples) == (2186, 8744)
    assert prts.period_s == pytest.approx(43.72)
    assert 6 * prts.period_s == pytest.approx(262.32)


def test_only_odd_harmonics_are_excited():
    spectrum = np.abs(np.fft.rfft(Prts().waveform())) / 8744
    assert spectrum[0::2].max() < 1e-12 * spectrum.max()
    in_band = spectrum[1:730:2]
    assert in_band.min() > 0
    assert (Prts().coefficients()[::2] == 0).all()


def test_amplitude_falls_as_one_over_frequency_up_to_16_7_hz():
    """State sequence is white at odd lines, so all that bends 1/f is the hold: 1.5 dB at 16.7 Hz."""
    prts = Prts()
    k = np.arange(1, prts.samples // 2, 2)
    f = k / prts.period_s
    magnitude = np.abs(prts.coefficients()[k])
    x = np.pi * k / prts.samples
    closed_form = np.abs(np.sin(4 * x)) / np.sin(x) ** 2
    assert magnitude == pytest.approx(closed_form * magnitude[0] / closed_form[0], rel=1e-9, abs=1e-15)
    relative = (magnitude * f) / (magnitude[0] * f[0])
    assert np.all(np.abs(relative[f <= 8.0] - 1) < 0.05)
    assert -1.5 < 20 * np.log10(relative[f <= 16.7].min()) < -1.4


def test_peak_and_peak_to_peak_amplitudes():
    peak = Prts(amplitude=3.0).waveform()
    assert np.abs(peak).max() == pytest.approx(3.0)
    between = Prts(amplitude=3.0, convention="peak_to_peak").waveform()
    assert np.ptp(between) == pytest.approx(3.0)
    assert between * 2 == pytest.approx(peak)


@pytest.mark.parametrize(("stages", "state_s", "rate_hz"), [(2, 0.25, 8.0), (4, 0.02, 200.0), (5, 0.1, 100.0)])
def test_any_length_and_state_duration(stages, state_s, rate_hz):
    prts = Prts(stages=stages, state_s=state_s, rate_hz=rate_hz, amplitude=2.0)
    x = prts.waveform()
    assert x.size == (3**stages - 1) * round(state_s * rate_hz)
    assert x.mean() == pytest.approx(0.0, abs=1e-12)
    assert np.abs(x).max() == pytest.approx(2.0)
    assert x[: x.size // 2] == pytest.approx(-x[x.size // 2 :])
    slopes = np.unique(np.round(np.diff(x) / np.abs(np.diff(x)).max(), 9))
    assert slopes.tolist() == [-1.0, 0.0, 1.0]
    assert prts.coefficients() == pytest.approx(np.fft.rfft(x) / x.size, abs=1e-12)


def test_the_cycle_starts_from_zero():
    x = Prts().waveform()
    assert abs(x[0]) <= np.abs(np.diff(x)).max() * 4 / 2


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("stages", 1),
        ("stages", 99),
        ("state_s", 0.0123),
        ("state_s", -1.0),
        ("state_s", 0.001),
        ("rate_hz", float("nan")),
        ("amplitude", 0.0),
        ("convention", "rms"),
    ],
)
def test_an_unusable_field_is_named_in_one_line(field, value):
    with pytest.raises(InputError) as caught:
        Prts(**{field: value})
    assert field in str(caught.value)
    assert "\n" not in str(caught.value)
