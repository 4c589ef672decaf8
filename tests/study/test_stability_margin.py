"""Studies whose fits must end at stable loops, and weights that no experiment knows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import DesignError
from mcstudy.fitting.status import Status
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

STUDY = """
[study]
name = "margin"
seed = 3

[group.free]
realizations = 1
starts = 3
fmax = [0.41]
amplitude = [1.0]

[group.held]
realizations = 1
starts = 3
fmax = [0.41]
amplitude = [1.0]
fit = { stability_margin = 0.1 }
"""


def test_every_end_of_a_study_with_a_margin_keeps_it_and_costs_more(tmp_path: Path) -> None:
    results = mc.run(parse_study(STUDY), tmp_path / "margin.zarr")
    free, held = results["free"], results["held"]
    growth, status = held["growth_rate"].values, held["status"].values
    assert (free["growth_rate"].values > 0).any()
    assert (growth[status != Status.UNSTABLE] <= -0.1).all()
    assert np.isnan(held["cost"].values[status == Status.UNSTABLE]).all()
    assert (held["cost"].min("start") > free["cost"].min("start")).all()
    stayed = free["growth_rate"].values <= -0.1
    assert (held["estimate"].values[stayed] == free["estimate"].values[stayed]).all()
    assert not verify(tmp_path / "margin.zarr").damage


def test_a_margin_is_part_of_the_fingerprint_only_where_one_is_set() -> None:
    study = parse_study(STUDY)
    assert "stability_margin" not in study.groups["free"].model_dump()["fit"]
    assert study.groups["held"].model_dump()["fit"]["stability_margin"] == 0.1


def test_a_margin_that_the_true_loop_does_not_keep_is_refused() -> None:
    with pytest.raises(DesignError, match=r"fit\.stability_margin: expected at most 1\.\d+ 1/s.*got 30"):
        parse_study(STUDY.replace("0.1 }", "30.0 }"))


def test_the_true_covariance_is_the_scatter_of_many_realizations() -> None:
    """Of odd lines, 150 realizations: a variance is then known to 8 %, and the mean of many of them to less."""
    from mcstudy.study.experiment import Experiment

    text = STUDY.replace(
        "[group.held]", "[spectra]\npoints = 'odd_lines'\nramp = 'remove'\ncovariance = 'true'\n[group.held]"
    )
    text = text.replace("amplitude = [1.0]", "amplitude = [1.0]\nfit.cost = 'ml'", 1)
    experiment = Experiment(parse_study(text).groups["free"], 1)
    drawn = [experiment.measure(1.0, r) for r in range(150)]
    assert (drawn[0].covariance == drawn[1].covariance).all()
    scatter = np.var([d.frf for d in drawn], axis=0)
    known = np.einsum("nii->ni", drawn[0].covariance).real
    assert (scatter / known).mean(axis=0) == pytest.approx([1, 1], abs=0.03)
