"""Explanations follow the study shown: computed from it, or measured with its settings in a study that exists."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr
from mcstudy_goodworth2018.paper import explanations
from mcstudy_goodworth2018.paper.explanations import _REASONS, explain_row
from mcstudy_goodworth2018.paper.published import PAPER
from mcstudy_goodworth2018.paper.statements import RESULTS

from mcstudy.analysis.show.text import comparison_title
from mcstudy.analysis.view import GroupView
from mcstudy.stance.body import two_segment

TOP = Path(__file__).parents[2]
Cube = Callable[..., xr.Dataset]


def texts(cube: xr.Dataset) -> dict[str, str]:
    """The explanation of every row, were it to differ, for a study of one group."""
    view = GroupView("a", cube)
    return {key: explain_row(key, view) for key in RESULTS}


def test_every_explained_row_exists() -> None:
    assert set(_REASONS) <= set(RESULTS)


def test_every_pipeline_and_example_an_explanation_names_exists(make_cube: Cube) -> None:
    named = {
        name for text in texts(make_cube()).values() for name in re.findall(r"pipelines/[\w/]+\.(?:toml|py)", text)
    }
    assert len(named) >= 4
    for name in named:
        assert (TOP / name).is_file(), name


def test_what_was_measured_elsewhere_is_marked_so_and_absent_for_other_settings(make_cube: Cube) -> None:
    for text in texts(make_cube()).values():
        assert ("mcstudy run" not in text) or explanations.MEASURED in text
    for settings in ({"spectra": {"width": 0.5}}, {"model": {"truth": {"K11": 900.0}}}):
        for key, text in texts(make_cube(**settings)).items():
            assert "pipelines/" not in text, key


def test_the_users_own_values_are_no_stand_in(make_cube: Cube) -> None:
    stand_in = {p.name: p.value for p in two_segment().parameters}
    own = {name: 0.99 * value for name, value in stand_in.items()}
    for truth, origin in (({}, "stand-in"), ({"K11": 900.0}, "stand-in"), (own, "your values (study file)")):
        cube = make_cube(model={"truth": truth})
        view = GroupView("a", cube)
        assert view.provenance.startswith(origin)
        assert view.provenance.endswith(": K11") == (len(truth) == 1)
        assert view.provenance.endswith("the body is the paper's") == (len(truth) > 1)
        paper = {"reference": PAPER, "rows": [{}]}
        title = comparison_title({"groups": {"a": {"truth_provenance": view.provenance}}, "paper": paper})
        assert title.startswith("Another body") == bool(truth)
        assert any("stand-in" in text for text in texts(cube).values()) == (not truth)


def test_bounds_are_named_only_where_fits_end_on_them(make_cube: Cube) -> None:
    free = make_cube(realizations=20)
    assert "bound" not in texts(free)["spread_fmax"].split(explanations.MEASURED)[0]
    bound = free.copy(deep=True)
    names = [str(n) for n in bound["parameter"].values]
    bound["at_bound"][..., names.index("Kpas1")] = 1
    bound["at_bound"][:, :, ::4, :, names.index("Td1")] = -1  # a quarter of the realizations
    text = texts(bound)["spread_fmax"]
    assert "at 0.41 Hz, Kpas1 ends on a bound in 100 % of best fits" in text
    assert "Td1" not in text


def test_a_trade_off_is_named_only_where_the_estimates_show_it(make_cube: Cube) -> None:
    cube = make_cube(realizations=40, starts=1, hit_rate=1.0)
    assert "takes up the scatter" not in texts(cube)["lowest_cv"]
    traded = cube.copy(deep=True)
    names = [str(n) for n in cube["parameter"].values]
    k22, kpas2 = names.index("K22"), names.index("Kpas2")
    shift = 40 * np.random.default_rng(2).standard_normal(cube["estimate"].shape[:-1])
    truth = cube["truth"].values
    traded["estimate"][..., k22] = truth[k22] + shift
    traded["estimate"][..., kpas2] = truth[kpas2] - shift + 1.0
    text = texts(traded)["lowest_cv"]
    assert "K22 takes up the scatter of Kpas2: their SD is 4" in text or "their SD is 3" in text
    assert "sum 0" in text


def test_the_origin_of_the_true_values_is_that_of_the_study_shown(make_cube: Cube) -> None:
    assert "stand-in for the lost Table I" in texts(make_cube())["highest_cv"]


def test_every_note_of_an_inferred_study_says_inferred_and_none_says_stand_in(make_cube: Cube) -> None:
    cube = make_cube(model={"truth": "inferred"})
    assert GroupView("a", cube).provenance.startswith("inferred from the paper's published numbers")
    for key, text in texts(cube).items():
        assert "inferred from the paper's published numbers" in text, key
        assert "stand-in" not in text, key
