"""What a fit tells of simulated coverage is what the coverage study found, and only where it applies."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

import mcstudy as mc
from mcstudy.files import schema
from mcstudy.identification import words
from mcstudy.identification.simulated_coverage import LEAST, MOST, Covered, nearest, simulated
from mcstudy.models.quantities import quantities
from mcstudy.report.person import figures
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment


def test_every_condition_has_every_quantity() -> None:
    names = [q.name for q in quantities(two_segment())]
    assert {(c.amplitude, c.cycles, c.fmax) for c in simulated()} == {
        (a, c, f) for a in (2.5, 5.0) for c in (3, 6) for f in (1.2, 3.1, 8.0)
    }
    for c in simulated():
        assert list(c.quantities) == names
        assert all(80 < x.lowest <= x.percent <= x.highest <= 100 for x in c.quantities.values())


def test_a_fit_tells_the_nearest_condition_and_no_other_kind_of_fit_does(fits: dict[str, mc.FitResult]) -> None:
    for case, cycles, fmax in (("good", 6, 3.1), ("short", 3, 3.1), ("low fmax", 3, 1.2)):
        found = fits[case].coverage
        assert found is not None
        assert (found.cycles, found.fmax) == (cycles, fmax)
    assert fits["on bounds"].coverage is None
    assert fits["effect added"].coverage is None
    good = fits["good"]
    assert nearest(good.recording, good.lines, good.model, good.level) == good.coverage
    assert nearest(good.recording, good.lines, good.model, 0.9) is None
    assert nearest(None, good.lines, good.model, good.level) is None


@pytest.mark.parametrize(
    ("amplitude", "convention", "found"),
    [(2.5, "peak", 2.5), (5.0, "peak_to_peak", 2.5), (1.0, "peak", 2.5), (6.0, "peak", 5.0)],
)
def test_similar_recordings_have_a_similar_torque(
    fits: dict[str, mc.FitResult], amplitude: float, convention: str, found: float
) -> None:
    """Half of the torque has twice the noise of the responses; how the amplitude is counted does not matter."""
    recording = mc.simulate(cycles=6, rate_hz=100.0, amplitude=(amplitude,) * 2, convention=convention)
    other = nearest(recording, measure(recording, 3.1), fits["good"].model, 0.95)
    assert other is not None
    assert (other.amplitude, other.cycles, other.fmax) == (found, 6, 3.1)
    assert f"at {found:g} N m (peak)" in other.condition


def test_words_data_and_figure_agree(fits: dict[str, mc.FitResult]) -> None:
    r = fits["good"]
    data, said = r.to_dict(), words.coverage(r)
    schema.validate("fit", data, "the fit")
    assert said in r.text()
    for q, percent in zip(data["quantities"], r.to_xarray().coverage.values, strict=True):
        c = q["coverage"]
        assert c["percent"] == percent
        assert c["remark"] == ("wider than needed" if percent > MOST else "too narrow" if percent < LEAST else "")
        assert (f"{q['name']} ({percent:.1f} %)" in said) == bool(c["remark"])
    axes = figures.coverage(r)
    drawn = [line.get_xdata() for line in axes.get_lines() if line.get_marker() == "D"]
    np.testing.assert_array_equal(np.ravel(drawn), [q["coverage"]["percent"] for q in data["quantities"]])
    plt.close(axes.figure)


def test_a_fit_without_simulated_coverage_says_nothing_of_it(fits: dict[str, mc.FitResult]) -> None:
    r = fits["effect added"]
    data = r.to_dict()
    assert data["coverage"] is None
    assert all(q["coverage"] is None for q in data["quantities"])
    assert words.coverage(r) == ""
    assert np.isnan(r.to_xarray().coverage.values).all()
    with pytest.raises(mc.InputError, match="expected a kind of recording whose intervals were simulated"):
        figures.coverage(r)


def test_intervals_that_are_too_narrow_are_named() -> None:
    assert Covered(92.9, 91.0, 95.0).remark == "too narrow"
    assert Covered(93.0, 91.0, 95.0).remark == ""
    assert Covered(97.1, 96.0, 99.0).remark == "wider than needed"
