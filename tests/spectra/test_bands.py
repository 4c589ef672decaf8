"""The paper's 28 points and their variants."""

import numpy as np
import pytest

from mcstudy.errors import InputError
from mcstudy.spectra import bands
from mcstudy.spectra.bands import Bands

PUBLISHED_HZ = (
    0.023, 0.069, 0.114, 0.183, 0.229, 0.275, 0.320, 0.366, 0.412, 0.435, 0.480, 0.526, 0.549, 0.640,
    0.801, 1.00, 1.28, 1.62, 2.01, 2.45, 3.04, 3.77, 4.60, 5.38, 5.92, 6.40, 7.09, 8.00,
)  # fmt: skip
"""The 28 frequencies as printed (Goodworth & Peterka 2018, Methods), Hz."""

NUMBERS = (
    "1 3 5 8 10 12 14 16 18 19 21 23 24 28 35 44 56 71 88 107 133 165 201 235 259 280 310 350"  # science of the paper
)


def test_the_points_are_the_published_harmonics():
    published = bands.published()
    assert published.harmonic.tolist() == [float(n) for n in NUMBERS.split()]
    assert len(published) == 28
    # Three are printed otherwise than they round: 0.274, 1.006 and 8.005 Hz.
    digits = [3 if f < 0.9 else 2 for f in PUBLISHED_HZ]
    off = [p for f, p, d in zip(published.f, PUBLISHED_HZ, digits, strict=True) if round(f, d) != p]
    assert off == [0.275, 1.00, 8.00]
    assert published.f == pytest.approx(PUBLISHED_HZ, rel=0.01)


@pytest.mark.parametrize("make", [bands.published, bands.averaged, bands.odd_lines])
def test_members_are_consecutive_odd_lines_centred_on_the_point(make):
    points = make()
    for members, harmonic in zip(points.members, points.harmonic, strict=True):
        assert (members % 2 == 1).all()
        assert (np.diff(members) == 2).all()
        assert members.mean() == harmonic


def test_points_above_0_55_hz_tile_the_odd_lines():
    members = bands.published().members
    wide = np.concatenate(members[13:])
    assert wide.tolist() == list(range(27, 370, 2))
    assert [m.tolist() for m in members[3:5]] == [[7, 9], [9, 11]]


def test_the_exception_is_averaged_in_the_variant_only():
    published, averaged = bands.published(), bands.averaged()
    assert np.array_equal(published.f, averaged.f)
    differ = [i for i, (a, b) in enumerate(zip(published.members, averaged.members, strict=True)) if a.size != b.size]
    assert published.harmonic[differ].tolist() == [19, 21, 23]
    assert all(published.members[i].size == 1 and averaged.members[i].size == 3 for i in differ)


@pytest.mark.parametrize(("fmax", "n", "n_odd"), [(0.41, 9, 9), (1.2, 16, 26), (8.0, 28, 175)])
def test_fmax_keeps_what_the_paper_keeps(fmax, n, n_odd):
    assert len(bands.published().below(fmax)) == n
    assert len(bands.odd_lines(fmax)) == n_odd
    assert len(bands.odd_lines(8.0).below(fmax)) == n_odd


def test_narrower_bands_average_fewer_lines_around_the_same_frequencies():
    published = bands.published()
    widths = (1.0, 0.5, 0.25, 1e-9)
    narrowed = [bands.narrower(published, w) for w in widths]
    for points in narrowed:
        assert np.array_equal(points.f, published.f)
        assert all((m % 2 == 1).all() and (np.diff(m) == 2).all() for m in points.members)
    counts = np.array([[m.size for m in points.members] for points in narrowed])
    assert counts[0].tolist() == [m.size for m in published.members]
    assert counts[1][-5:].tolist() == [7, 5, 6, 10, 10]
    assert counts[3].tolist() == [2 - c % 2 for c in counts[0]]
    assert (np.diff(counts, axis=0) <= 0).all()
    # the nearest count that keeps the centre: never off by more than one line from the fraction asked for
    wanted = np.maximum(np.array(widths)[:, None] * counts[0], counts[3])
    assert (abs(counts - wanted) <= 1).all()


@pytest.mark.parametrize("width", [0.0, -1.0, 1.5, float("nan")])
def test_a_width_that_is_no_fraction_is_refused(width):
    with pytest.raises(InputError, match="bands width: expected a fraction"):
        bands.narrower(bands.published(), width)


def test_the_8_hz_point_can_be_dropped():
    assert bands.published().without(8.0).harmonic.tolist() == bands.published().harmonic.tolist()[:-1]


def test_means_and_their_covariance():
    points = Bands((np.array([1]), np.array([3, 5]), np.array([5, 7])), period_s=10.0)
    assert points.lines.tolist() == [1, 3, 5, 7]
    assert points.f == pytest.approx([0.1, 0.4, 0.6])
    values = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]])
    assert points.average(values).tolist() == [[1, 2], [4, 5], [6, 7]]
    assert points.weights @ values == pytest.approx(points.average(values))
    covariance = np.arange(1, 5)[:, None, None] * np.array([[2.0, 1j], [-1j, 1.0]])
    assert points.average_covariance(covariance)[1] == pytest.approx((covariance[1] + covariance[2]) / 4)


def test_nothing_left_is_an_error():
    with pytest.raises(InputError, match=r"first is 0\.0229"):
        bands.published().below(0.001)
    with pytest.raises(InputError, match="f_max"):
        bands.odd_lines(0.001)
    with pytest.raises(InputError, match="at least one"):
        Bands((), 10.0)
    with pytest.raises(InputError, match="at least one"):
        Bands((np.array([0]),), 10.0)
