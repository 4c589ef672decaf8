"""Lines: unbiased FRFs whose stated covariance is the scatter they have, from periodic and other stimuli."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from mcstudy.errors import RecordingError
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.spectra.lines import EvenLines, Lines
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway, sway_psd
from mcstudy.stance.stimulus import Prts

PRTS = Prts(rate_hz=100.0)
MODEL = two_segment()
LONGEST = 6 * PRTS.samples
NOISE = NoiseSway(MODEL, MODEL.truth, SensorNoise(), 2 * LONGEST, PRTS.rate_hz)


def periodic(seed: int, trials: int = 2, cycles: int = 6, stimulus: np.ndarray | None = None) -> Recording:
    """Steady-state sway evoked by one period of a stimulus, PRTS by default, with noise."""
    u = PRTS.waveform() if stimulus is None else stimulus
    evoked, rng = stimulus_sway(MODEL, MODEL.truth, u, PRTS.rate_hz), np.random.default_rng(seed)
    n = cycles * u.size
    return Recording(
        tuple(
            Trial(np.tile(u, cycles), np.tile(evoked, (cycles, 1)) + NOISE.sample(rng)[:n], 5.0) for _ in range(trials)
        ),
        PRTS.rate_hz,
        u.size / PRTS.rate_hz,
    )


def aperiodic(seed: int) -> Recording:
    """262 s of sway evoked by filtered noise that never repeats."""
    rng, n = np.random.default_rng(seed), LONGEST
    f = np.arange(n // 2 + 1) / (n / PRTS.rate_hz)
    white = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
    colour = np.where(f > 0, 1.0 / np.hypot(0.1, f), 0.0) / (1 + (f / 12.0) ** 4)
    u = np.fft.irfft(white * colour, n)
    u *= 3.0 / u.std()
    theta = stimulus_sway(MODEL, MODEL.truth, u, PRTS.rate_hz) + NOISE.sample(rng)[:n]
    return Recording((Trial(u, theta),), PRTS.rate_hz, None)


def whitened(lines: Lines) -> np.ndarray:
    """Standardised errors (N, 2) against the truth."""
    error = lines.y - frf(MODEL, MODEL.truth, lines.f)
    return np.einsum("nij,nj->ni", np.linalg.inv(np.linalg.cholesky(lines.noise.C)), error)


def test_prts_gives_its_odd_lines() -> None:
    lines = measure(periodic(0))
    assert lines.harmonic is not None
    np.testing.assert_array_equal(lines.harmonic % 2, 1)
    assert len(lines) == 175
    assert lines.repeats.shape == (10, len(lines), 2)
    np.testing.assert_allclose(lines.weight.sum(axis=0), 1)
    np.testing.assert_allclose(np.einsum("rn,rnj->nj", lines.weight, lines.repeats), lines.y)


def test_covariance_is_that_of_the_errors_in_every_band() -> None:
    """The largest of all checks: below 1 Hz, 1 to 3 Hz and to 8 Hz, and without correlation between the lines."""
    errors = np.array([whitened(measure(periodic(seed))) for seed in range(24)])
    f = measure(periodic(0)).f
    dof = measure(periodic(0)).noise.dof
    expected = dof / (dof - 2)  # mean of the inverse of a complex Wishart matrix of two rows
    for low, high in ((0, 1), (1, 3), (3, 8)):
        band = (f > low) & (f <= high)
        power = (np.abs(errors[:, band]) ** 2).mean(axis=2) / expected[band]
        assert power.mean() == pytest.approx(1.0, abs=0.10)
        # Were the errors of a band common to its lines, the scatter of the band's mean would be several times this.
        ideal = 1 / np.sqrt(2 * band.sum())
        assert power.mean(axis=1).std() < 2.2 * ideal


def test_the_covariance_is_unbiased_at_every_line() -> None:
    """Against the spectrum of the noise that was simulated: no user has a correction to remember."""
    lines = [measure(periodic(seed)) for seed in range(8)]
    found = [2 * PRTS.period_s * x.noise.variance * (len(x.repeats) * x.power)[:, None] for x in lines]
    true = np.einsum("nii->ni", sway_psd(MODEL, MODEL.truth, SensorNoise(), lines[0].f)).real
    ratio = np.mean(found, axis=0) / true
    assert np.abs(np.log(ratio)).mean() < 0.12
    for low, high in ((0, 0.3), (0.3, 1), (1, 3), (3, 8)):
        band = (lines[0].f > low) & (lines[0].f <= high)
        assert ratio[band].mean() == pytest.approx(1.0, abs=0.10)


def test_all_lines_are_used_when_the_stimulus_excites_them_all() -> None:
    rng = np.random.default_rng(5)
    n = 2000
    phases = np.exp(2j * np.pi * rng.random(n // 2 + 1)) / np.arange(1, n // 2 + 2)
    u = np.fft.irfft(phases, n)
    recording = periodic(1, trials=3, cycles=10, stimulus=5 * u / np.abs(u).max())
    lines = measure(recording)
    assert lines.harmonic is not None
    np.testing.assert_array_equal(lines.harmonic, np.arange(1, lines.harmonic[-1] + 1))
    assert lines.even is None
    assert (np.abs(whitened(lines)) ** 2).mean() == pytest.approx(1.0, abs=0.25)


def test_the_noise_of_a_stimulus_with_few_lines_is_that_of_one_with_all() -> None:
    """Estimated from the excited lines up to 0.7 Hz alone, it would follow chance."""
    coefficients = np.fft.rfft(PRTS.waveform())
    kept = np.arange(coefficients.size) < 32
    few = measure(periodic(3, trials=1, stimulus=np.fft.irfft(coefficients * kept, PRTS.samples)))
    every = measure(periodic(3, trials=1)).below(0.72)
    np.testing.assert_allclose(few.f, every.f)
    for name in ("C", "dof"):
        np.testing.assert_allclose(getattr(few.noise, name), getattr(every.noise, name), rtol=1e-3)


def test_segments_of_a_stimulus_that_never_repeats() -> None:
    errors = [whitened(measure(aperiodic(seed), fmax=4.0)) for seed in range(8)]
    assert np.mean(np.abs(errors) ** 2) == pytest.approx(1.1, abs=0.25)
    lines = measure(aperiodic(0), fmax=4.0)
    assert lines.repeats.shape[0] >= 4
    np.testing.assert_allclose(np.einsum("rn,rnj->nj", lines.weight, lines.repeats), lines.y)


def test_sway_of_a_recording_follows_from_power_and_response() -> None:
    """sum 2 power |y|^2 over the lines is the mean square of the evoked sway."""
    recording = periodic(0, trials=1)
    lines = measure(recording)
    evoked = stimulus_sway(MODEL, MODEL.truth, PRTS.waveform(), PRTS.rate_hz)
    H = frf(MODEL, MODEL.truth, lines.f)
    np.testing.assert_allclose((2 * lines.power[:, None] * np.abs(H) ** 2).sum(axis=0), evoked.var(axis=0), rtol=0.01)
    random = aperiodic(3)
    lines = measure(random)
    H = frf(MODEL, MODEL.truth, lines.f)
    evoked = stimulus_sway(MODEL, MODEL.truth, random.trials[0].stimulus, PRTS.rate_hz)
    coefficients = np.fft.rfft(evoked, axis=0, norm="forward")
    f = np.arange(coefficients.shape[0]) * PRTS.rate_hz / evoked.shape[0]
    covered = (f > lines.f[0] / 2) & (f < lines.f[-1] + lines.f[0] / 2)
    total = (2 * lines.power[:, None] * np.abs(H) ** 2).sum(axis=0)
    np.testing.assert_allclose(total, 2 * (np.abs(coefficients[covered]) ** 2).sum(axis=0), rtol=0.2)


def test_even_lines_show_an_even_nonlinearity_and_nothing_else() -> None:
    clean = [measure(periodic(seed)).even for seed in range(10)]
    p = np.array([e.excess(0.02, 2.0)[1] for e in clean if e is not None])
    assert p.shape == (10, 2)
    assert (p < 0.05).mean() <= 0.2
    recording = periodic(0)
    bent = replace(recording, trials=tuple(replace(t, theta=t.theta + 20 * t.theta**2) for t in recording.trials))
    even = measure(bent).even
    assert even is not None
    assert (even.excess(0.02, 2.0)[1] < 1e-3).any()


def test_the_p_value_of_even_lines_is_that_of_a_ratio_of_independent_powers() -> None:
    """Of 3 lines and 4 repeats: an F of 6 and 18 degrees of freedom, two for each independent complex number."""
    even = EvenLines(np.arange(3.0), np.full((3, 2), 1.5 + 0j), np.ones((3, 2)), np.ones((3, 2)), 4)
    ratio, p = even.excess()
    np.testing.assert_allclose(ratio, 2.25)
    np.testing.assert_allclose(p, f_distribution.sf(2.25, 6, 18))


def test_halves_and_amplitudes_are_parts_of_the_same_repeats() -> None:
    recording = periodic(0, trials=2)
    weak = replace(recording.trials[1], stimulus=0.6 * recording.trials[1].stimulus, amplitude=3.0)
    lines = measure(replace(recording, trials=(recording.trials[0], weak)))
    halves = lines.halves()
    assert halves is not None
    first, last = halves
    assert set(first.cycle) == {1, 2}
    assert set(last.cycle) == {4, 5}
    groups = lines.by_amplitude()
    assert [round(a, 3) for a, _ in groups] == [3.0, 5.0]
    assert all(g.repeats.shape[0] == 5 for _, g in groups)
    # Covariance follows the share of the stimulus' power, 9 : 25.
    ratio = groups[0][1].noise.C[:, 0, 0].real / groups[1][1].noise.C[:, 0, 0].real
    np.testing.assert_allclose(ratio, 25 / 9)


def test_too_short_recordings_are_refused_by_name() -> None:
    with pytest.raises(RecordingError, match="trial 1: expected at least 3 cycles"):
        measure(periodic(0, cycles=2))
    whole = aperiodic(0)
    short = Trial(whole.trials[0].stimulus[:500], whole.trials[0].theta[:500])
    with pytest.raises(RecordingError, match=r"duration: 5\.0 s"):
        measure(replace(whole, trials=(short,)))
    with pytest.raises(RecordingError, match="rate_hz: 100 Hz does not reach"):
        measure(periodic(0), fmax=60)
