"""Groups of a study compared realization by realization, and the paper's claims about changed settings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from mcstudy_goodworth2018.paper.published import VARIANTS

import mcstudy.analysis.registration  # noqa: F401 - registers .mc
from mcstudy.analysis.compare import MEASURES, compare, comparisons
from mcstudy.analysis.show.tables import report_of
from mcstudy.analysis.view import GroupView, StudyView
from mcstudy.errors import InputError
from mcstudy.study.study_file import read_study

Cube = Callable[..., xr.Dataset]
HALF = {"model": {"bounds": {"lower": 0.5}}}


def tree(**groups: xr.Dataset) -> xr.DataTree:
    root = xr.Dataset(attrs={"title": "invented", "fingerprint": "f" * 64, "seed": 7})
    return xr.DataTree.from_dict({"/": root, **groups})


def shrunk(cube: xr.Dataset, factor: float) -> xr.Dataset:
    """The cube with every estimate drawn towards the truth."""
    estimate = cube["truth"] + factor * (cube["estimate"] - cube["truth"])
    return cube.assign(estimate=estimate.transpose(*cube["estimate"].dims))


def value(comparison: Any, measure: str, fmax: float) -> tuple[float, float]:
    here = comparison.result.sel(measure=measure, fmax=fmax)
    return float(here["value"]), float(here["mcse"])


def test_the_difference_is_that_of_the_groups_own_statistics(make_cube: Cube) -> None:
    a, b = make_cube(realizations=30, spread=0.2), make_cube(realizations=30, spread=0.2, seed=2, **HALF)
    comparison = compare(GroupView("a", a), GroupView("b", b))
    assert comparison is not None
    assert comparison.differences == ["model.bounds.lower = 0.5"]
    for fmax in (0.41, 1.2, 8.0):
        best = [c["estimate"].where(c["cost"] == c["cost"].min("start")).mean("start").sel(fmax=fmax) for c in (a, b)]
        relative = [x / a["truth"] for x in best]
        bias = [100 * abs(x.mean("realization") - 1).mean() for x in relative]
        spread = [100 * x.std("realization", ddof=1).mean() for x in relative]
        rmse = [100 * np.sqrt(((x - 1) ** 2).mean("realization")).mean() for x in relative]
        for measure, (first, second) in {"bias": bias, "spread": spread, "rmse": rmse}.items():
            assert value(comparison, measure, fmax)[0] == pytest.approx(float(second - first), abs=1e-9), measure
    hit = [100 * (c["cost"] <= c["cost"].min("start") * 1.001).mean() for c in (a, b)]
    assert np.mean([value(comparison, "hits", f)[0] for f in (0.41, 1.2, 8.0)]) == pytest.approx(float(hit[1] - hit[0]))


def test_common_noise_makes_the_difference_better_known_than_either_group(make_cube: Cube) -> None:
    cube = make_cube(realizations=50, spread=0.3)
    same_noise = compare(
        GroupView("a", cube), GroupView("b", shrunk(make_cube(realizations=50, spread=0.3, **HALF), 0.98))
    )
    other_noise = compare(
        GroupView("a", cube), GroupView("b", shrunk(make_cube(realizations=50, spread=0.3, seed=2, **HALF), 0.98))
    )
    assert same_noise is not None
    assert other_noise is not None
    difference, paired = value(same_noise, "spread", 8.0)
    unpaired = value(other_noise, "spread", 8.0)[1]
    assert difference == pytest.approx(-0.02 * 30, rel=0.1)
    assert abs(difference) > 5 * paired
    assert paired < unpaired / 20


def test_frfs_are_compared_up_to_fmax_at_the_frequencies_both_have(make_cube: Cube) -> None:
    a = make_cube(realizations=100, spread=0.1)
    b = make_cube(realizations=100, spread=0.1, seed=2, spectra={"exclude_hz": (8.0,)})
    low = b["frequency"] < 1.0
    noisy = b["true_frf"] + (b["frf"] - b["true_frf"]) * xr.where(low, 3.0, 1.0)
    shifted = (noisy + xr.where(low, 0.0, 0.5) * b["true_frf"]).transpose(*b["frf"].dims)
    comparison = compare(GroupView("a", a), GroupView("b", b.assign(frf=shifted)))
    assert comparison is not None
    assert value(comparison, "frf_spread", 0.41)[0] == pytest.approx(20, rel=0.05)
    points = len(b["frequency"])
    assert value(comparison, "frf_spread", 8.0)[0] == pytest.approx(20 * float(low.sum()) / points, rel=0.1)
    assert value(comparison, "frf_error", 8.0)[0] == pytest.approx(50 * (points - float(low.sum())) / points, rel=0.1)


def test_a_realization_that_one_group_could_not_use_is_left_out_of_both(make_cube: Cube) -> None:
    a, b = make_cube(realizations=20, spread=0.2), shrunk(make_cube(realizations=20, spread=0.2, **HALF), 0.5)
    outlier = a.copy(deep=True)
    outlier["estimate"][:, :, 3] = 1e6
    failed = b.copy(deep=True)
    failed["status"][:, :, 3] = 0
    with_gap = compare(GroupView("a", outlier), GroupView("b", failed))
    keep = [r for r in range(20) if r != 3]
    without = compare(GroupView("a", a.isel(realization=keep)), GroupView("b", b.isel(realization=keep)))
    assert with_gap is not None
    assert without is not None
    for measure in ("bias", "spread", "rmse", "unstable", "on_bound"):
        assert value(with_gap, measure, 1.2) == pytest.approx(value(without, measure, 1.2))


def test_the_reference_is_the_group_in_the_papers_setting(make_cube: Cube) -> None:
    study = StudyView(
        tree(
            odd=make_cube(realizations=5, spectra={"ramp": "remove"}),
            paper=make_cube(realizations=5),
            more_starts=make_cube(realizations=5, starts=9),
            ideal=make_cube(realizations=5, simulator="none"),
            silent=make_cube(realizations=5, noise={"psd": (0.0, 0.0)}),
            two=make_cube(realizations=2, **HALF),
            elsewhere=make_cube(realizations=5, fmax=(2.0,), **HALF),
            one_segment=make_cube(realizations=5, model={"kind": "one_segment"}),
        )
    )
    assert [(c.reference, c.group) for c in comparisons(study)] == [("paper", "odd")]


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda v: v.study)
def test_every_claim_can_come_out_either_way(make_cube: Cube, variant: Any) -> None:
    settings: dict[str, Any] = {
        "lower_bound_half": HALF,
        "no_averaging_exception": {"spectra": {"points": "averaged"}},
        "without_8hz": {"spectra": {"exclude_hz": (8.0,)}},
    }[variant.study]
    paper, changed = make_cube(realizations=50, spread=0.3), make_cube(realizations=50, spread=0.3, **settings)

    def verdicts(better: float, biased: float, unstable: tuple[float, float]) -> dict[str, set[str]]:
        a, b = (c.copy(deep=True) for c in (paper, changed))
        b = shrunk(b, better)
        b["estimate"] = b["estimate"] + biased * b["truth"]
        b["frf"] = b["true_frf"] + better * (b["frf"] - b["true_frf"])
        for cube, share in zip((a, b), unstable, strict=True):
            cube["growth_rate"] = xr.where(cube["realization"] < share * 50, 1.0, -1.0).broadcast_like(cube["cost"])
        found = compare(GroupView("paper", a), GroupView("b", b))
        assert found is not None
        out: dict[str, set[str]] = {}
        for v in found.verdicts:
            assert v.claim is variant
            out.setdefault(v.expectation.measure, set()).add(v.verdict)
        return out

    expected = {e.measure for e in variant.expects}
    as_claimed, opposite = verdicts(0.5, 1.0 if "bias" in expected else 0.0, (0.8, 0.1)), verdicts(2.0, 0.0, (0.1, 0.8))
    assert set(as_claimed) == set(opposite) == expected
    assert set.union(*as_claimed.values()) == {"agrees"}
    for measure in expected - {"bias"}:
        assert opposite[measure] == {"contradicts"}, measure
    assert set.union(*verdicts(1.0, 0.0, (0.3, 0.3)).values()) == {"undecided"}


def test_the_pipeline_of_every_claim_holds_the_setting_it_is_about(make_cube: Cube) -> None:
    folder = Path(__file__).parents[2] / "pipelines"
    for variant in VARIANTS:
        study = read_study(folder / f"{variant.study}.toml")
        groups = {}
        for name, group in study.groups.items():
            settings = group.model_dump(exclude={"realizations", "starts"})
            groups[name] = make_cube(realizations=4, starts=2, **settings)
        found = [v for c in comparisons(StudyView(tree(**groups))) for v in c.verdicts]
        assert {v.claim for v in found} == {variant}
        assert len(found) == sum(len(e.fmax) for e in variant.expects)


def test_the_section_is_in_the_text_and_the_json(make_cube: Cube) -> None:
    report = report_of(tree(paper=make_cube(realizations=8), lower_half=make_cube(realizations=8, seed=2, **HALF)))
    (comparison,) = report.data["comparisons"]
    assert comparison["group"] == "lower_half"
    assert [c["fmax"] for c in comparison["cells"]] == [0.41, 1.2, 8.0]
    assert set(comparison["cells"][0]) == {"fmax", *MEASURES}
    assert {c["verdict"] for c in comparison["claims"]} <= {"agrees", "contradicts", "undecided"}
    text = report.details()
    assert "Compared with group paper" in text
    assert "RMSE lower at 1.2 Hz: " in text
    assert all(len(line) <= 160 for line in text.splitlines())
    assert comparisons(StudyView(tree(paper=make_cube(realizations=8)))) == []


def seeded(cube: xr.Dataset, seed: int) -> xr.Dataset:
    return cube.assign_attrs(seed=seed)


def test_two_cubes_of_one_seed_are_paired_as_groups_of_one_study_are(make_cube: Cube) -> None:
    a, b = make_cube(realizations=30, spread=0.3), shrunk(make_cube(realizations=25, spread=0.3, **HALF), 0.9)
    within = compare(GroupView("a", a), GroupView("b", b))
    assert within is not None
    found = seeded(a, 7).mc.compare(seeded(b, 7))
    xr.testing.assert_allclose(found["value"].drop_vars("meaning"), within.result["value"])
    xr.testing.assert_allclose(found["mcse"].drop_vars("meaning"), within.result["mcse"])
    assert found.attrs["errors"] == "paired by realization"
    assert found.attrs["realizations"] == 25
    assert found.attrs["settings"] == "model.bounds.lower = 0.5"
    assert found["value"].attrs == {"long_name": "difference, the other minus this", "units": "%"}
    nodes = tree(a=seeded(a, 7)), tree(b=seeded(b, 7))
    xr.testing.assert_identical(nodes[0]["a"].mc.compare(nodes[1]["b"]), found)


@pytest.mark.parametrize("seeds", [(7, 8), (7, None)])
def test_cubes_that_do_not_share_their_noise_are_independent(make_cube: Cube, seeds: tuple[int, int | None]) -> None:
    settings: dict[str, Any] = {"amplitude": (3.0,), "spread": 0.3}
    a, b = make_cube(realizations=30, **settings), make_cube(realizations=50, seed=2, **settings)
    b = shrunk(b, 0.8)
    mine, theirs = (x if s is None else seeded(x, s) for x, s in zip((a, b), seeds, strict=True))
    found = mine.mc.compare(theirs)
    assert found.attrs["errors"] == "of independent realizations"
    assert found.attrs["realizations"] == 30
    for measure, method in (("bias", "mean_absolute_bias_percent"), ("spread", "mean_spread_percent")):
        first, second = (getattr(x.mc, method)().isel(amplitude=0) for x in (a, b))
        here = found.sel(measure=measure)
        np.testing.assert_allclose(here["value"], second["value"] - first["value"], rtol=1e-9)
        np.testing.assert_allclose(here["mcse"], np.hypot(first["mcse"], second["mcse"]), rtol=1e-9)
    assert bool(np.isfinite(found.sel(measure=["hits", "unstable"])["mcse"]).all())
    size = [100 * abs(x["frf"] / x["true_frf"] - 1).std("realization", ddof=1).mean() for x in (a, b)]
    assert abs(float(found["value"].sel(measure="frf_spread", fmax=8.0) - (size[1] - size[0]))) < 1.0


def test_a_cube_compared_with_itself_differs_by_nothing(make_cube: Cube) -> None:
    cube = seeded(make_cube(realizations=10, spread=0.3), 7)
    found = cube.mc.compare(cube)
    assert found.attrs["settings"] == "the same"
    np.testing.assert_allclose(found["value"], 0.0, atol=1e-12)
    np.testing.assert_allclose(found["mcse"], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"model": {"kind": "one_segment"}}, "parameter: expected K11, K12"),
        ({"stimulus": {"kind": "platform_translation"}}, "amplitude: expected values in N m as in this, got"),
        ({"fmax": (2.0,)}, "fmax: expected one of 0.41, 1.2, 8 as in this, got 2 in the other"),
        ({"amplitude": (7.0,)}, "amplitude: expected one of 3, 5 as in this, got 7 in the other"),
        ({"realizations": 2}, "realization: expected at least 3 in common of this and the other, got 2"),
    ],
)
def test_cubes_that_cannot_be_compared_are_refused_in_one_line(
    make_cube: Cube, settings: dict[str, Any], line: str
) -> None:
    a, b = seeded(make_cube(), 7), seeded(make_cube(**settings), 7)
    with pytest.raises(InputError) as refused:
        a.mc.compare(b)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)
    if "realizations" in settings:
        with pytest.raises(InputError, match="realization: expected at least 3 each, got 6 in this and 2 in the other"):
            a.mc.compare(seeded(b, 8))


def test_only_a_group_with_its_starts_can_be_compared(make_cube: Cube) -> None:
    cube = make_cube()
    for other, line in ((cube.mc.best(), "all its starts"), (3, "expected a group of a cube, got int")):
        with pytest.raises(InputError, match=line):
            cube.mc.compare(other)
    with pytest.raises(InputError, match="choose a group: a, b"):
        cube.mc.compare(tree(a=cube, b=cube))


def test_a_study_can_be_shown_beside_another(make_cube: Cube) -> None:
    ideal = make_cube(realizations=2, simulator="none")
    a = tree(main=seeded(make_cube(realizations=8), 7), ideal=ideal, new=make_cube(realizations=8))
    b = tree(main=seeded(make_cube(realizations=9, seed=2, **HALF), 8), ideal=ideal)
    report = report_of(b, a, "a.zarr")
    (comparison,) = report.data["comparisons"]
    assert (comparison["group"], comparison["reference"]) == ("main", "main of a.zarr")
    assert comparison["paired"] is False
    assert report.data["not_compared"] == {
        "ideal": "realization: expected at least 3 each, got 2 in ideal of a.zarr and 2 in ideal"
    }
    text = report.text()
    assert "the other group minus main of a.zarr, independent (other seed)" in " ".join(text.split())
    assert "Group ideal is not compared: realization: expected at least 3" in text
    one = report_of(tree(b=b["main"].to_dataset()), tree(a=a["main"].to_dataset())).data["comparisons"]
    assert [c["reference"] for c in one] == ["a of the reference"]
    with pytest.raises(InputError, match=r"a\.zarr: expected a group of the same name, one of x, got main, ideal"):
        report_of(tree(x=ideal), a, "a.zarr")
    with pytest.raises(InputError, match="realization: expected at least 3 each"):
        report_of(tree(ideal=ideal), tree(ideal=ideal), "a.zarr")
