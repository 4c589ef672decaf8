"""What the paper says about Fig. 7C, for our stand-in truth."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.analysis.sensitivity import influence, sensitivity
from mcstudy.errors import InputError
from mcstudy.spectra.bands import published
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

MODEL, F = two_segment(), published().f


def test_values_are_j_true_between_the_two_frfs() -> None:
    out = sensitivity(MODEL, MODEL.truth, F)
    assert {str(r): out.sizes[d] for d, r in (("range", "range"), ("direction", "direction"))} == {
        "range": 3,
        "direction": 2,
    }
    mid = (F > 0.43) & (F < 2.5)
    changed = MODEL.truth.copy()
    changed[3] *= 1.1
    true, other = frf(MODEL, MODEL.truth, F[mid]), frf(MODEL, changed, F[mid])
    expected = (np.abs((true - other) / np.abs(true)) ** 2).sum() / (2 * mid.sum())
    got = out["value"].sel(range="mid", direction=0.1, parameter="K22")
    assert float(got) == pytest.approx(expected, rel=1e-9)


def test_delays_matter_at_high_frequency_and_not_at_low() -> None:
    share = sensitivity(MODEL, MODEL.truth, F)["share"]
    for delay in ("Td1", "Td2"):
        assert float(share.sel(range="low", parameter=delay)) < 0.01
        assert float(share.sel(range="high", parameter=delay)) > 5 * float(share.sel(range="low", parameter=delay))


def test_the_outermost_published_points_belong_to_their_ranges() -> None:
    only_edges = sensitivity(MODEL, MODEL.truth, F[[0, -1]])
    assert list(only_edges["range"].values) == ["low", "high"]


def test_influence_has_one_number_a_parameter() -> None:
    out = influence(MODEL, MODEL.truth, F)
    assert out.dims == ("parameter",)
    assert (out > 0).all()


def test_frequencies_outside_every_range_are_refused() -> None:
    with pytest.raises(InputError, match="none of the 1 frequencies"):
        sensitivity(MODEL, MODEL.truth, np.array([20.0]))
