"""Random numbers belong to coordinates, not to the order of work."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.streams import noise_stream, start_stream, stream
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import parse_study


def grown(tiny: str, *edits: tuple[str, str]) -> Experiment:
    for old, new in edits:
        assert old in tiny
        tiny = tiny.replace(old, new, 1)
    study = parse_study(tiny)
    return Experiment(study.groups["noisy"], study.study.seed)


def test_a_stream_never_changes_between_versions() -> None:
    # A stored cube can only be extended, resumed or verified if these bits stay what they are.
    assert stream(2018, "noise", 0).bit_generator.random_raw(2).tolist() == [2922371434817367971, 1353846847248304009]


@pytest.mark.parametrize("other", [stream(1, "a", 0), stream(1, "b", 0), stream(1, "a", 1), stream(1, "a", 0, 0)])
def test_streams_of_different_purposes_and_coordinates_differ(other: np.random.Generator) -> None:
    assert (other.random(4) != stream(1, "a", 12).random(4)).all()


def test_noise_and_starts_of_a_realization_are_independent_draws() -> None:
    assert abs(np.corrcoef(noise_stream(1, 3).random(10_000), start_stream(1, 3).random(10_000))[0, 1]) < 0.05


def test_more_starts_begin_with_the_same_starts(tiny: str) -> None:
    few, many = grown(tiny), grown(tiny, ("starts = 6", "starts = 60"))
    problem = few.problem(few.measure(3.0, 2), 1.2)
    np.testing.assert_array_equal(many.starts([problem], [2])[0, :6], few.starts([problem], [2])[0])


@pytest.mark.parametrize(
    "edit",
    [
        ("realizations = 5", "realizations = 500"),
        ("[0.41, 1.2]", "[0.3, 0.41, 1.2, 8.0]"),
        ("[3.0, 5.0]", "[3.0, 4.0, 5.0]"),
        ("starts = 6", "starts = 60"),
        (
            "[group.noisy]",
            "[group.other]\nrealizations = 1\nstarts = 1\nfmax = [8.0]\namplitude = [1.0]\n[group.noisy]",
        ),
    ],
)
def test_growing_any_axis_leaves_the_data_of_a_cell_bit_identical(tiny: str, edit: tuple[str, str]) -> None:
    before, after = grown(tiny).measure(5.0, 3), grown(tiny, edit).measure(5.0, 3)
    assert before.frf.tobytes() == after.frf.tobytes()
    assert before.covariance is not None
    assert after.covariance is not None
    assert before.covariance.tobytes() == after.covariance.tobytes()


def test_amplitudes_share_their_noise(tiny: str) -> None:
    experiment = grown(tiny, ("seed = 7", "seed = 7\n[spectra]\npoints = 'odd_lines'"))
    errors = {a: experiment.measure(a, 1).frf - experiment.true_frf for a in (3.0, 5.0)}
    np.testing.assert_allclose(errors[3.0] * 3.0, errors[5.0] * 5.0, rtol=1e-6)
