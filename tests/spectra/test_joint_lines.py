"""Lines of several recordings as one set."""

from __future__ import annotations

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.spectra.lines import Lines, joined
from mcstudy.spectra.measure import measure


@pytest.fixture(scope="module")
def parts() -> list[Lines]:
    ankle = mc.simulate(seed=1, cycles=3, rate_hz=50)
    hip = mc.simulate(seed=2, cycles=4, rate_hz=50, stimulus="hip_torque")
    return [measure(ankle, 1.2), measure(hip, 2.0)]


def test_the_mean_of_the_repeats_is_the_response_of_every_recording(parts: list[Lines]) -> None:
    both = joined(parts)
    np.testing.assert_allclose(np.einsum("rn,rnj->nj", both.weight, both.repeats), both.y)
    np.testing.assert_allclose(both.weight.sum(axis=0), 1.0)
    assert np.unique(both.trial).size == 4
    assert both.counts == tuple(map(len, parts))
    np.testing.assert_array_equal(both.y[both.blocks[1]], parts[1].y)


def test_lines_and_repeats_are_chosen_recording_by_recording(parts: list[Lines]) -> None:
    both = joined(parts)
    below = both.below(1.0)
    assert below.counts == tuple(len(p.below(1.0)) for p in parts)
    half = both.subset(both.cycle == 1)
    np.testing.assert_allclose(half.y[half.blocks[0]], parts[0].subset(parts[0].cycle == 1).y)
    np.testing.assert_allclose(half.noise.C[half.blocks[1]], parts[1].subset(parts[1].cycle == 1).noise.C)


def test_a_single_recording_stays_as_it_is(parts: list[Lines]) -> None:
    assert joined(parts[:1]) is parts[0]
    assert parts[0].parts == (parts[0],)


def test_noise_is_drawn_with_the_degrees_of_freedom_of_its_own_recording(parts: list[Lines]) -> None:
    """The variance of whitened errors is above one by the uncertainty of the covariance, which differs by recording."""
    both = joined(parts)
    drawn = both.noise.draw(np.random.default_rng(0), 400).reshape(2, len(both), 2, 400)
    for part, block in zip(parts, both.blocks, strict=True):
        alone = part.noise.draw(np.random.default_rng(1), 400)
        assert (drawn[:, block] ** 2).mean() == pytest.approx((alone**2).mean(), rel=0.05)
    z, roots = both.noise.joint_draws(np.random.default_rng(0), 3)
    assert z.shape == (len(both), 2, 3)
    assert roots.shape == (len(both), 2, 2, 3)
    assert not both.noise.known
