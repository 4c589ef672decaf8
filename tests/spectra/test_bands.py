"""The paper's 28 points and their variants."""

import numpy as np
import pytest

from mcstudy.errors import InputError
from mcstudy.spectra import bands

NUMBERS = (
    "1 3 5 8 10 12 14 16 18 19 21 23 24 28 35 44 56 71 88 107 133 165 201 235 259 280 310 350"  # science of the paper
)


def test_the_points_are_the_published_harmonics():
    published = bands.published()
    assert published.harmonic.tolist() == [float(n) for n in NUMBERS.split()]
    assert len(published) == 28
    # Three are printed otherwise than they round: 0.274, 1.006 and 8.005 Hz.
    digits = [3 if f < 0.9 else 2 for f in bands.PUBLISHED_HZ]
    off = [p for f, p, d in zip(published.f, bands.PUBLISHED_HZ, digits, strict=True) if round(f, d) != p]
    assert off == [0.275, 1.00, 8.00]
    assert published.f == pytest.approx(bands.PUBLISHED_HZ, rel=0.01)


@pytest.mark.parametrize("make", [bands.published, bands.averaged, bands.without_8hz, bands.odd_lines])
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


def test_the_8_hz_point_can_be_dropped():
    assert bands.without_8hz().harmonic.tolist() == bands.published().harmonic.tolist()[:-1]


def test_means_and_their_covariance():
    points = bands.of_sets([[1], [3, 5], [5, 7]], period_s=10.0)
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
        bands.of_sets([])
    with pytest.raises(InputError, match="at least one"):
        bands.of_sets([[0]])
