"""A stimulus given by its lines is that waveform, offers what the sequence offers, and is a stimulus of a study."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.errors import DesignError, InputError
from mcstudy.stance.line_stimulus import LineStimulus
from mcstudy.stance.stimulus import Prts
from mcstudy.study.design import Study
from mcstudy.study.measure import kept_points, stimulus
from mcstudy.study.study_file import parse_study

PRTS = Prts(stages=5, amplitude=3.0)


def of_sequence(harmonic: np.ndarray) -> dict[str, list[float]]:
    c = PRTS.coefficients()[harmonic]
    return {
        "harmonic": harmonic.tolist(),
        "weight": np.abs(c).tolist(),
        "phase_deg": np.degrees(np.angle(c)).tolist(),
    }


def test_the_lines_of_a_sequence_are_that_sequence() -> None:
    lines = of_sequence(np.arange(1, PRTS.samples // 2, 2))
    found = LineStimulus(**{k: tuple(v) for k, v in lines.items()}, samples=PRTS.samples, amplitude=3.0)
    np.testing.assert_allclose(found.coefficients(), PRTS.coefficients(), atol=1e-12)
    np.testing.assert_allclose(found.waveform(), PRTS.waveform(), atol=1e-10)
    assert found.period_s == PRTS.period_s


def test_a_waveform_reaches_its_amplitude_and_has_no_even_line() -> None:
    found = LineStimulus((1, 5, 21), (1.0, 0.5, 0.2), (0.0, 30.0, 250.0), 968, 200.0, 4.0, "peak_to_peak")
    assert np.abs(found.waveform()).max() == pytest.approx(2.0)
    spectrum = np.fft.rfft(found.waveform()) / 968
    np.testing.assert_allclose(spectrum, found.coefficients(), atol=1e-12)
    assert np.flatnonzero(np.abs(spectrum) > 1e-9).tolist() == [1, 5, 21]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"harmonic": [1, 4]}, "stimulus.lines.harmonic: expected odd harmonics"),
        ({"weight": [1.0]}, "stimulus.lines.weight: expected 2 numbers"),
        ({"harmonic": [1, 4373]}, "stimulus.lines.harmonic: expected harmonics below half of the 8744"),
    ],
)
def test_lines_that_are_no_stimulus_are_refused_in_one_line(change: dict[str, list[float]], words: str) -> None:
    lines = {"harmonic": [1, 3], "weight": [1.0, 1.0], "phase_deg": [0.0, 0.0]} | change
    with pytest.raises((DesignError, InputError)) as error:
        Study("a", seed=1).group("g", realizations=1, starts=1, fmax=[8.0], amplitude=[5.0], stimulus={"lines": lines})
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_a_study_fits_only_the_lines_that_are_excited_and_its_file_keeps_them() -> None:
    harmonic = np.array([1, 3, 7, 21, 41, 71, 101])
    axes = {"realizations": 1, "starts": 1, "fmax": [8.0], "amplitude": [5.0]}
    study = Study("a", seed=1).group(
        "g", **axes, stimulus={"lines": of_sequence(harmonic)}, spectra={"points": "odd_lines"}
    )
    group = study.groups["g"]
    assert kept_points(group).lines.tolist() == harmonic.tolist()
    assert np.abs(stimulus(group, 5.0).waveform()).max() == pytest.approx(5.0)
    assert parse_study(study.to_toml()).fingerprint == study.fingerprint
    sequence = Study("a", seed=1).group("g", **axes, spectra={"points": "odd_lines"})
    assert "stimulus.lines" not in sequence.to_toml()  # older cubes keep their fingerprint
    assert sequence.fingerprint != study.fingerprint
