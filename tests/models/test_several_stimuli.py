"""A model under several stimuli, each recorded by itself, is studied as one: every frequency under each in turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import mcstudy as mc
from mcstudy.analysis.compare import comparisons
from mcstudy.analysis.view import StudyView
from mcstudy.cli import main
from mcstudy.errors import DesignError
from mcstudy.models.record import ModelTable
from mcstudy.planning.fits import Fitter
from mcstudy.stance.joint import members
from mcstudy.stance.response import frf
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "arm"
seed = 5

[model]
name = "arm"
joints = ["shoulder", "elbow"]
{stimuli}
term = [
  {{ joint = "shoulder", sense = "shoulder", order = 2, coefficient = 0.30 }},
  {{ joint = "shoulder", sense = "elbow", order = 2, coefficient = 0.09 }},
  {{ joint = "elbow", sense = "shoulder", order = 2, coefficient = 0.09 }},
  {{ joint = "elbow", sense = "elbow", order = 2, coefficient = 0.08 }},
  {{ joint = "shoulder", sense = "shoulder", gain = "K1", delay = "Td", noisy = true }},
  {{ joint = "shoulder", sense = "shoulder", gain = "B1", order = 1 }},
  {{ joint = "elbow", sense = "elbow", gain = "K2", delay = "Td", noisy = true }},
  {{ joint = "elbow", sense = "elbow", gain = "B2", order = 1 }},
  {terms}
]
parameter = [
  {{ name = "K1", unit = "N m/rad", value = 30.0 }},
  {{ name = "B1", unit = "N m s/rad", value = 3.0 }},
  {{ name = "K2", unit = "N m/rad", value = 12.0 }},
  {{ name = "B2", unit = "N m s/rad", value = 1.2 }},
  {{ name = "Td", unit = "s", value = 0.04 }},
]

[group.one]
realizations = 12
starts = 2
fmax = [1.2, 8.0]
amplitude = [2.0]
fit.cost = "ml"
spectra.points = "odd_lines"
store.standard_errors = true
"""

TWO = STUDY.format(
    stimuli='stimulus = [{ name = "push" }, { name = "pull", unit = "N" }]',
    terms='{ joint = "shoulder", sense = "push" }, { joint = "elbow", sense = "pull", coefficient = 0.3 },',
)
ONE = STUDY.format(stimuli="", terms='{ joint = "shoulder", sense = "stimulus" },')


def experiment(text: str) -> Experiment:
    study = parse_study(text)
    return Experiment(study.groups["one"], study.study.seed)


def test_every_frequency_is_measured_under_each_stimulus_in_turn_with_noise_of_its_own() -> None:
    two, one = experiment(TWO), experiment(ONE)
    np.testing.assert_array_equal(two.f, np.repeat(one.f, 2))
    assert two.n_frequencies == tuple(2 * n for n in one.n_frequencies)
    theirs, ours = one.measure(2.0, 3), two.measure(2.0, 3)
    np.testing.assert_array_equal(ours.frf[::2], theirs.frf)  # the first stimulus: the same noise
    under = members(two.model)[1]
    noise = [data - true for data, true in ((ours.frf[::2], two.true_frf[::2]), (ours.frf[1::2], two.true_frf[1::2]))]
    np.testing.assert_allclose(two.true_frf[1::2], frf(under, under.truth, one.f), rtol=1e-12)
    correlation = np.vdot(noise[0], noise[1]) / np.linalg.norm(noise[0]) / np.linalg.norm(noise[1])
    assert abs(correlation) < 0.3


def test_a_second_stimulus_narrows_the_estimates_as_theory_says(tmp_path: Path) -> None:
    out = tmp_path / "arm.zarr"
    mc.run(parse_study(TWO), out)
    tree = xr.open_datatree(out, engine="zarr")
    assert list(tree["one"]["stimulus"].values[:3]) == ["push", "pull", "push"]
    cells = mc.open_results(out)["one"].to_dataset()
    bound = cells.mc.efficiency()
    sd = cells.mc.best().estimate.std("realization", ddof=1)
    ratio = (sd / bound["cramer_rao_sd"]).sel(fmax=8.0)
    assert 0.6 < float(ratio.mean()) < 1.5  # 12 realizations
    assert main(["verify", str(out)]) == 0
    assert main(["report", str(out)]) == 0


def test_stimuli_are_written_back_and_wrong_ones_are_one_line() -> None:
    model = parse_study(TWO).groups["one"].model
    table = ModelTable.of(model.model())
    assert [s.name for s in table.stimulus] == ["push", "pull"]
    assert table.model().table.entry.tolist() == model.model().table.entry.tolist()
    for text, expected in (
        (TWO.replace('name = "pull"', 'name = "push"'), "expected a name of its own"),
        (TWO.replace('sense = "pull"', 'sense = "push"'), "expected one that senses the pull"),
        (TWO.replace('sense = "pull"', 'sense = "stimulus"'), "expected push, pull"),
    ):
        with pytest.raises(DesignError, match=expected):
            parse_study(text)


def test_a_group_applies_some_of_the_stimuli() -> None:
    both, pull = (
        experiment(TWO),
        experiment(TWO.replace("amplitude = [2.0]", 'amplitude = [2.0]\nstimulus.applied = ["pull"]')),
    )
    assert pull.model.stimulus_names == ("pull",)
    np.testing.assert_array_equal(pull.true_frf, both.true_frf[1::2])
    with pytest.raises(DesignError, match=r"stimulus\.applied: expected one of push, pull, got 'tilt'"):
        parse_study(TWO.replace("[group.one]", '[group.one]\nstimulus.applied = ["tilt"]'))


def test_linearised_starts_that_a_model_cannot_have_are_refused_before_a_study_begins() -> None:
    hidden = TWO.replace("[group.one]", '[group.one]\nfit.starts = "linearised"').replace(
        "parameter = [", 'output = [{ name = "hand", value = "shoulder + 0.5*elbow" }]\nparameter = ['
    )
    with pytest.raises(DesignError, match=r"fit\.starts: .* need outputs that tell all of shoulder, elbow, got hand"):
        parse_study(hidden)


def test_the_law_of_the_responses_holds_the_stimuli_in_turn_and_independent() -> None:
    two, one = (Fitter(parse_study(text).groups["one"], 5, (8.0,)) for text in (TWO, ONE))
    both, first = two.law(4), one.law(4)
    np.testing.assert_allclose(both.mean, two.experiment(4).true_frf, rtol=1e-12)
    np.testing.assert_allclose(both.covariance[::2], first.covariance, rtol=1e-12)
    N = len(first.mean)
    joint = both.joint.reshape(N, 2, 2, N, 2, 2)
    np.testing.assert_allclose(joint[:, 0, :, :, 0], first.joint.reshape(N, 2, N, 2), rtol=1e-12)
    assert not joint[:, 0, :, :, 1].any()
    drawn = both.draw(np.random.default_rng(1).standard_normal((400, both.size)), 2.0)
    spread = np.var(drawn, axis=0) / (np.einsum("nii->ni", both.covariance).real / 4.0)
    np.testing.assert_allclose(spread.mean(axis=0), 1.0, atol=0.02)


def test_solve_counts_the_time_of_every_stimulus() -> None:
    short = parse_study(TWO.replace("[1.2, 8.0]", "[8.0]") + "stimulus = { stages = 4, state_s = 0.1, cycles = 4 }\n")
    found = mc.solve(short, "cv(K1) <= 50%", "amplitude=1:4", budget_fits=4000)
    assert found.design["amplitude"] == 1.0
    assert found.to_dict()["recording_s"] == pytest.approx(2 * 4 * 8.0)


def test_groups_under_several_stimuli_are_compared_by_their_responses(tmp_path: Path) -> None:
    more = TWO + TWO[TWO.index("[group.one]") :].replace("[group.one]", "[group.more]") + "stimulus.cycles = 21\n"
    out = tmp_path / "arms.zarr"
    mc.run(parse_study(more), out)
    (compared,) = comparisons(StudyView(mc.open_results(out)))
    error = []
    for name in ("one", "more"):
        cube = mc.open_results(out)[name].to_dataset().isel(amplitude=0)
        relative = (cube["frf"] / cube["true_frf"]).values
        error.append(100 * np.sqrt(relative.real.var(axis=0, ddof=1) + relative.imag.var(axis=0, ddof=1)).mean())
    assert float(compared.result["value"].sel(measure="frf_spread", fmax=8.0)) == pytest.approx(error[1] - error[0])
