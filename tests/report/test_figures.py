"""Every figure draws what it claims, on the axes it is given."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

pytest.importorskip("matplotlib")

from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from mcstudy_goodworth2018.alternatives import figures as alternative_figures
from mcstudy_goodworth2018.alternatives.files import read_alternative

from mcstudy.analysis.search.by_starts import best_of_first
from mcstudy.analysis.selection import best
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.report import figures
from mcstudy.report.figures import common
from mcstudy.report.figures.optimiser import best_by_starts_of
from mcstudy.report.figures.pairs import draw_correlations
from mcstudy.report.figures.responses import phase_errors
from mcstudy.report.figures.signals import Signals, envelope
from mcstudy.report.frame import place
from mcstudy.report.study.standard_errors import zipper_figures
from mcstudy.report.svg import drawn, style
from mcstudy.stance.response import frf


def with_errors(node: xr.DataTree) -> xr.Dataset:
    """A group with standard errors, a tenth of the true values; K11 is on a bound in the first realization."""
    data = node.to_dataset()
    size = (data["estimate"].isel(start=0, drop=True) * 0 + 0.1 * data["truth"]).load()
    size.loc[{"realization": 0, "parameter": "K11"}] = np.nan
    return data.assign(standard_error=size)


GROUP_FIGURES: dict[str, Callable[[xr.DataTree, Axes], Axes]] = {
    "parameter_bars": lambda t, ax: figures.parameter_bars(t["accuracy"], "K11", ax),
    "bias_bars": lambda t, ax: figures.bias_bars(t["accuracy"], ax=ax),
    "cv_bars": lambda t, ax: figures.cv_bars(t["accuracy"], ax=ax),
    "sensitivity_bars": lambda t, ax: figures.sensitivity_bars(t["accuracy"], "mid", ax),
    "statistic_by_fmax": lambda t, ax: figures.statistic_by_fmax(t["accuracy"], "unstable", ax),
    "efficiency_dots": lambda t, ax: figures.efficiency_dots(t["accuracy"], ax=ax),
    "correlation_map": lambda t, ax: figures.correlation_map(t["accuracy"], ax=ax),
    "estimate_scatter": lambda t, ax: figures.estimate_scatter(t["accuracy"], "K11", "Kpas1", ax=ax),
    "zipper": lambda t, ax: figures.zipper(with_errors(t["accuracy"]), "B11", ax=ax),
    "controller_error": lambda t, ax: figures.controller_error(t["theory"], fmax=8.0, ax=ax),
    "controller_error_by_noise": lambda t, ax: figures.controller_error_by_noise(t["accuracy"], ax=ax),
    "determined_dots": lambda t, ax: figures.determined_dots(t["accuracy"], ax=ax),
    "starts_curve": lambda t, ax: figures.starts_curve(t["accuracy"], ax=ax),
    "waterfall": lambda t, ax: figures.waterfall(t["accuracy"], ax=ax),
    "frf_gain": lambda t, ax: figures.frf_gain(t["theory"], ax=ax),
    "frf_phase": lambda t, ax: figures.frf_phase(t["accuracy"], ax=ax),
    "controller_gain": lambda t, ax: figures.controller_gain(t["accuracy"], ax=ax),
    "controller_phase": lambda t, ax: figures.controller_phase(t["theory"], ax=ax),
    "basin_atlas": lambda t, ax: figures.basin_atlas(t["accuracy"], ax=ax),
    "bias_by_starts": lambda t, ax: figures.bias_by_starts(t["accuracy"], ax),
    "cv_by_starts": lambda t, ax: figures.cv_by_starts(t["accuracy"], ax),
    "hit_rate_bars": lambda t, ax: figures.hit_rate_bars(
        t["accuracy"].mc.hit_rate_by_start().isel(amplitude=-1), "title", ax
    ),
}
RESULT_FIGURES: dict[str, Callable[[list[Path], Axes], Axes]] = {
    "controller_off": lambda files, ax: alternative_figures.controller_off(read_alternative(files[0]), "T11", ax),  # type: ignore[arg-type]
    "population_bias": lambda files, ax: alternative_figures.population_bias(read_alternative(files[1]), ax),  # type: ignore[arg-type]
}
SIGNAL_FIGURES = [
    name for name in figures.__all__ if name.endswith(("_record", "_spectrum", "error_frf")) and name != "Signals"
]


@pytest.fixture
def ax() -> Axes:
    return Figure().add_subplot()


@pytest.fixture(scope="session")
def signals(paper_tree: xr.DataTree) -> Signals:
    return Signals.of(paper_tree["accuracy"], int(paper_tree.attrs["seed"]), 3.0)


def _drawn(ax: Axes) -> int:
    return len(ax.lines) + len(ax.patches) + len(ax.collections)


@pytest.mark.parametrize("name", GROUP_FIGURES)
def test_a_group_figure_fills_and_returns_the_axes_it_is_given(name: str, paper_tree: xr.DataTree, ax: Axes) -> None:
    assert GROUP_FIGURES[name](paper_tree, ax) is ax
    assert _drawn(ax) > 0
    ax.figure.draw_without_rendering()  # type: ignore[union-attr]


def test_a_zipper_has_a_line_per_interval_and_shows_which_miss_the_truth(paper_tree: xr.DataTree, ax: Axes) -> None:
    data = with_errors(paper_tree["accuracy"])
    figures.zipper(data, "K11", amplitude=5.0, fmax=1.2, ax=ax)
    best_fits = data.mc.best().sel(amplitude=5.0, fmax=1.2, parameter="K11")
    off = abs(best_fits["estimate"] - best_fits["truth"])[1:] / best_fits["standard_error"][1:]
    holding, missing = (len(c.get_segments()) for c in ax.collections)  # type: ignore[attr-defined]
    assert missing == int((off > 1.96).sum())
    assert holding + missing == off.size
    (shown,) = zipper_figures(GroupView("accuracy", data))
    assert len(shown.panels) == len(shown.tables[0].rows) == 12
    assert zipper_figures(GroupView("accuracy", paper_tree["accuracy"].to_dataset())) == []
    with pytest.raises(InputError, match="standard_error: the group has none"):
        figures.zipper(paper_tree["accuracy"], "K11")


def test_a_statistic_by_fmax_is_that_of_the_best_fits(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.statistic_by_fmax(paper_tree["accuracy"], "unstable", ax)
    expected = 100 * paper_tree["accuracy"].mc.unstable()["value"]
    drawn = [np.asarray(c.lines[0].get_ydata()) for c in ax.containers]  # type: ignore[attr-defined]
    np.testing.assert_allclose(drawn, expected.transpose("amplitude", "fmax"))
    with pytest.raises(InputError, match="statistic: expected one of mean_absolute_bias_percent"):
        figures.statistic_by_fmax(paper_tree["accuracy"], "bias")


@pytest.mark.parametrize("name", SIGNAL_FIGURES)
def test_a_signal_figure_fills_and_returns_the_axes_it_is_given(name: str, signals: Signals, ax: Axes) -> None:
    assert getattr(figures, name)(signals, ax) is ax
    assert _drawn(ax) > 0


@pytest.mark.parametrize("name", RESULT_FIGURES)
def test_a_figure_of_an_example_fills_and_returns_the_axes(name: str, alternatives: list[Path], ax: Axes) -> None:
    assert RESULT_FIGURES[name](alternatives, ax) is ax
    assert _drawn(ax) > 0
    ax.figure.draw_without_rendering()  # type: ignore[union-attr]


def test_every_figure_is_tested_here() -> None:
    drawn = {*GROUP_FIGURES, *SIGNAL_FIGURES, "Signals", "influence_shares"}
    assert drawn == set(figures.__all__)


def test_bars_are_the_truth_and_the_means_of_the_best_fits(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.parameter_bars(paper_tree["accuracy"], "B22", ax)
    cells = best(paper_tree["accuracy"].to_dataset()).compute().sel(parameter="B22")
    expected = [float(cells["truth"]), *cells["estimate"].mean("realization").values.ravel()]
    heights = [patch.get_height() for patch in ax.patches]  # type: ignore[attr-defined]
    assert heights == pytest.approx(expected)
    first, second = (ax.patches[1 + 3 * i].get_x() for i in range(2))  # type: ignore[attr-defined]
    assert second < first, "5 N m stands left of 3 N m, as in the paper"


def test_a_combined_stiffness_is_drawn_by_its_name(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.parameter_bars(paper_tree["accuracy"], "K11+Kpas1", ax)
    truth = paper_tree["accuracy"]["truth"].sel(parameter=["K11", "Kpas1"]).sum()
    assert ax.patches[0].get_height() == pytest.approx(float(truth))  # type: ignore[attr-defined]


@pytest.mark.parametrize("bars", [figures.bias_bars, figures.cv_bars])
def test_combined_parameters_differ_from_single_ones_without_colour(
    bars: Callable[..., Axes], paper_tree: xr.DataTree, ax: Axes
) -> None:
    bars(paper_tree["accuracy"], ax=ax)
    names = [t.get_text() for t in ax.get_yticklabels()]
    hatched = {names[round(p.get_y() + p.get_height() / 2)] for p in ax.patches if p.get_hatch()}
    assert hatched == {n for n in names if "+" in n} != set()


def test_two_angles_over_time_have_lines_of_unequal_width(signals: Signals, ax: Axes) -> None:
    figures.sway_record(signals, ax)
    first, second = (line.get_linewidth() for line in ax.lines)
    assert first > 1.3 * second


def test_unknown_parameters_fmax_and_amplitudes_are_named(paper_tree: xr.DataTree, ax: Axes) -> None:
    with pytest.raises(InputError, match="parameter: expected one of K11"):
        figures.parameter_bars(paper_tree["accuracy"], "K99", ax)
    with pytest.raises(InputError, match=r"fmax: expected one of 0\.41, 1\.2, 8 Hz, got 3"):
        figures.bias_bars(paper_tree["accuracy"], 3.0, ax)
    with pytest.raises(InputError, match="amplitude: expected one of 3, 5, got 7"):
        figures.waterfall(paper_tree["accuracy"], 7.0, ax=ax)


def test_the_line_of_figure_4_is_the_closed_form(paper_tree: xr.DataTree, ax: Axes) -> None:
    view = figures.common.view_of(paper_tree["theory"])
    figures.frf_gain(view, ax=ax)
    f, drawn = ax.lines[0].get_xydata().T
    assert set(paper_tree["theory"]["frequency"].values) < set(f), "finer than the study, to show resonances"
    assert np.allclose(drawn, np.abs(frf(view.model, view.model.truth, f))[:, 0])


def test_bands_of_phases_do_not_jump_by_whole_turns() -> None:
    """Fits that scatter about half a turn from the truth, and a delay of three turns: both are drawn without jumps."""
    rng, f = np.random.default_rng(3), np.linspace(0.1, 3.0, 400)
    drift = np.pi * np.minimum(f, 1.0) + 0.3 * rng.standard_normal((50, 1))
    errors = phase_errors(np.exp(1j * drift))
    assert np.abs(np.diff(errors, axis=1)).max() < 0.1
    assert np.allclose(errors, drift)
    delayed = phase_errors(np.exp(-2j * np.pi * f * (1 + 0.01 * rng.standard_normal((50, 1)))))
    assert np.allclose(np.quantile(delayed, 0.5, axis=0), -2 * np.pi * f, atol=0.3)


def test_phases_are_those_of_stable_fits(paper_tree: xr.DataTree, ax: Axes) -> None:
    group = paper_tree["accuracy"].to_dataset().load()
    unstable = group["growth_rate"] * 0 + 1
    figures.frf_phase(group.assign(growth_rate=unstable), ax=ax)
    assert len(ax.collections) == 0
    figures.frf_phase(group.assign(growth_rate=-unstable), ax=ax)
    assert len(ax.collections) == 2


def test_a_map_of_correlations_writes_the_large_ones_out(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.correlation_map(paper_tree["accuracy"], amplitude=5.0, fmax=1.2, ax=ax)
    r = paper_tree["accuracy"].mc.correlation()["value"].sel(amplitude=5.0, fmax=1.2).values
    pairs = np.abs(r[np.tril_indices(12, -1)])
    assert len(ax.texts) == int((pairs >= 0.3).sum()) > 0
    first = ax.texts[0]
    i, j = (round(v) for v in first.get_position())
    assert float(first.get_text().replace("−", "-")) == pytest.approx(100 * r[i, j], abs=0.5)


def _laid_out(drawing: Callable[[Axes], object], size: tuple[float, float]) -> tuple[Axes, RendererBase]:
    """Axes as they stand on the page, and what measures their texts."""
    with style():
        ax = drawn(drawing, size)
        for text in ax.texts:
            text.set_text(text.get_text().replace("-", "−"))  # as on the page, and wider
        renderer = ax.figure.canvas.get_renderer()  # type: ignore[union-attr,attr-defined]
        place(ax, renderer)
    return ax, renderer


def test_numbers_side_by_side_on_a_map_of_correlations_do_not_touch() -> None:
    names = [f"Kpas{i}" for i in range(12)]
    ax, renderer = _laid_out(lambda ax: draw_correlations(ax, names, np.full((12, 12), -0.93)), (4.3, 4.3))
    boxes = [t.get_window_extent(renderer) for t in ax.texts if t.get_position()[1] == 0]
    assert len(boxes) == 11
    boxes.sort(key=lambda box: float(box.x0))
    assert all(right.x0 - left.x1 > 1.0 for left, right in pairwise(boxes))


def test_the_legend_of_a_scatter_covers_no_point(paper_tree: xr.DataTree) -> None:
    ax, renderer = _laid_out(
        lambda ax: figures.estimate_scatter(paper_tree["accuracy"], "K11", "Kpas1", ax=ax), (4.3, 4.3)
    )
    legend = ax.get_legend()
    assert legend is not None
    box = legend.get_window_extent(renderer)
    assert box.x0 >= 0
    assert box.x1 <= 72 * 4.3
    assert box.y1 < ax.get_window_extent(renderer).y0


def test_names_in_an_atlas_lie_between_its_bars_and_the_edge(paper_tree: xr.DataTree) -> None:
    ax, renderer = _laid_out(lambda ax: figures.basin_atlas(paper_tree["accuracy"], ax=ax), (4.3, 4.4))
    boxes = {t.get_text(): t.get_window_extent(renderer) for t in ax.texts}
    frame = ax.get_window_extent(renderer)
    last = len(ax.get_yticks()) - 1

    def height(row: float) -> float:
        return float(ax.transData.transform((0, row))[1])

    upper, lower = boxes["upper bound"], boxes["lower bound"]
    assert height(-0.4) < upper.y0 < upper.y1 <= frame.y1
    assert frame.y0 <= lower.y0 < lower.y1 < height(last + 0.4)
    heading = boxes["starts\nlowest"]
    assert heading.y0 > max(box.y1 for text, box in boxes.items() if "/" in text)


def test_the_dashed_line_of_a_scatter_holds_the_pairs_with_the_true_sum(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.estimate_scatter(paper_tree["accuracy"], "K11", "Kpas1", ax=ax)
    x, y = ax.lines[-1].get_xydata().T
    assert x + y == pytest.approx(1057 + 146)


def test_a_scatter_of_many_realizations_shows_the_first(
    paper_tree: xr.DataTree, ax: Axes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcstudy.report.figures.pairs.MOST_POINTS", 2)
    figures.estimate_scatter(paper_tree["accuracy"], "K11", "Kpas1", ax=ax)
    assert [len(line.get_xdata()) for line in ax.lines[:3]] == [2, 2, 2]


def test_a_waterfall_starts_at_the_lowest_cost_and_never_falls(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.waterfall(paper_tree["accuracy"], ax=ax)
    assert len(ax.lines) == paper_tree["accuracy"].sizes["realization"]
    for line in ax.lines:
        y = np.asarray(line.get_ydata())
        assert y[0] == 1.0
        assert (np.diff(y) >= 0).all()


def test_the_curve_of_starts_never_rises_and_ends_at_the_mean_minimum(paper_tree: xr.DataTree, ax: Axes) -> None:
    figures.starts_curve(paper_tree["accuracy"], fmax=1.2, ax=ax)
    lowest = paper_tree["accuracy"]["cost"].sel(fmax=1.2).min("start").mean("realization")
    for line, end in zip(ax.lines, lowest.values, strict=True):
        y = np.asarray(line.get_ydata(), dtype=float)
        assert (np.diff(y) <= 1e-12).all()
        assert y[-1] == pytest.approx(end)


def test_an_envelope_keeps_every_extreme_of_a_long_record() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal(50_000)
    t, y = envelope(np.arange(50_000) / 200.0, x)
    assert len(t) == len(y) < 1000
    assert (y.min(), y.max()) == (x.min(), x.max())


def test_the_noise_of_figure_2_is_the_noise_that_was_fitted(paper_tree: xr.DataTree, signals: Signals) -> None:
    """FRF of the cube less the closed form is the drawn noise over the stimulus, at an unaveraged line."""
    data = paper_tree["accuracy"]["frf"].sel(amplitude=3.0, realization=0).isel(frequency=0).values
    true = paper_tree["accuracy"]["true_frf"].isel(frequency=0).values
    drive = signals.periodic.coefficients()[1]
    assert np.allclose(data - true, signals.noise_spectrum[1] / drive, rtol=1e-9)


def test_sampling_explains_the_error_of_a_time_simulation_once_the_transient_is_left_out(signals: Signals) -> None:
    f, error = signals.frf_error(discard=1)
    assert np.allclose(error, signals.sampling_error(f)[:, None], rtol=0.02, atol=1e-8)
    _, with_transient = signals.frf_error(discard=0)
    assert (with_transient > 20 * error).all()


def test_curves_over_starts_of_a_large_group_show_its_first_realizations_and_say_so(
    paper_tree: xr.DataTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = GroupView("accuracy", paper_tree["accuracy"].to_dataset())
    assert common.sampled(whole) == 5
    assert common.of_all(whole, 5) == ""
    monkeypatch.setattr(common, "MOST_STARTS", 60)  # of 150
    assert common.sampled(whole) == 2
    assert "the first 2 of 5 realizations" in common.of_all(whole, common.sampled(whole))
    few = best_of_first(whole.cube.isel(realization=slice(0, 2)))
    xr.testing.assert_equal(best_by_starts_of(whole), few.compute())
