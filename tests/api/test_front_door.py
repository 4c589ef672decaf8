"""What `import mcstudy` offers, in the lines that a person would write."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest
import xarray as xr
from matplotlib import pyplot as plt

import mcstudy as mc
from mcstudy.analysis.show.tables import show
from mcstudy.cli import main
from mcstudy.errors import DesignError, InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.study.study_file import parse_study

LINES = """
import mcstudy as mc
study = mc.Study("pilot", seed=1).group("accuracy", realizations=50, starts=10, fmax=[1.2, 8], amplitude=[3, 5])
mc.plan(study)                                   # fits, bytes, seconds, expected Monte Carlo error
results = mc.run(study, "pilot.zarr")            # progress; the same call resumes; scheduler=/workers= as on the command line
results["accuracy"].mc.cv()["value"].plot()      # right label, right unit
mc.summary(results)                              # what `mcstudy show` prints
rec = mc.read_recording("subject1.nc")           # or mc.simulate(effects={"sensor_lag_theta1": 0.01})
d = mc.diagnose(rec, fast=True); d               # short repr, table in a notebook
d.plot.misfit_gain(angle=1); d.to_html("s1.html"); d.to_dict()
mc.effects["passive_damping_ankle"]              # a mapping by name
"""  # noqa: E501


@pytest.fixture(scope="module")
def after(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The names that the lines leave, and the folder they ran in."""
    folder = tmp_path_factory.mktemp("door")
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        mc.write_recording(mc.simulate(effects={"sensor_lag_theta1": 0.01}, cycles=4, rate_hz=100.0), "subject1.nc")
        mpl.use("agg")
        exec(LINES, names)
        plt.close("all")
    return {**names, "folder": folder}


def test_the_lines_run_and_say_what_the_command_line_says(
    after: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    out = after["folder"] / "pilot.zarr"
    assert after["study"].fits == 50 * 10 * 2 * 2
    assert isinstance(after["results"], xr.DataTree)
    assert repr(mc.summary(after["results"])) == repr(mc.summary(str(out))) == show(out).text()
    assert main(["show", str(out)]) == Exit.DONE
    assert capsys.readouterr().out.strip() == repr(mc.summary(out)).strip()
    schema.validate("show", mc.summary(out).to_dict(), "show")


def test_the_same_call_resumes(after: dict[str, Any]) -> None:
    again = mc.run(after["study"], str(after["folder"] / "pilot.zarr"), workers=1)
    assert again["accuracy"].to_dataset().identical(after["results"]["accuracy"].to_dataset())


def test_a_statistic_knows_its_label_and_unit(after: dict[str, Any]) -> None:
    value = after["results"]["accuracy"].mc.cv()["value"]
    assert value.attrs["long_name"]
    assert "units" in value.attrs


def test_a_plan_and_a_study_file_are_those_of_the_command_line(after: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "pilot.toml"
    file.write_text(after["study"].to_toml())
    assert parse_study(after["study"].to_toml()) == mc.read_study(str(file)) == after["study"]
    assert mc.read_study(file).fingerprint == after["study"].fingerprint
    shown = repr(mc.plan(after["study"], workers=2))
    assert shown.startswith("study pilot, seed 1\n")
    assert "total: 2000 fits" in shown
    assert "on 2 threads" in shown


def test_a_diagnosis_is_short_at_a_prompt_and_whole_on_its_page(after: dict[str, Any]) -> None:
    d = after["d"]
    assert repr(d).startswith("Diagnosis\n")
    assert len(repr(d)) < 1000
    assert d._repr_html_().count("<table>") >= 4
    page = (after["folder"] / "s1.html").read_text(encoding="utf-8")
    assert '<figure id="misfit"' in page
    plain = json.loads(json.dumps(d.to_dict(), allow_nan=False))
    schema.validate("diagnosis", plain, "diagnosis")
    assert plain["detected"]
    assert "misfit_gain" in repr(d.plot)


def test_a_path_is_as_good_as_a_recording(after: dict[str, Any]) -> None:
    by_name = mc.diagnose(str(after["folder"] / "subject1.nc"), fast=True)
    assert by_name.to_dict() == after["d"].to_dict()
    with pytest.raises(InputError, match="bootstrap: expected without fast"):
        mc.diagnose(after["rec"], fast=True, bootstrap=100)


def test_a_study_grows_by_new_studies_and_every_mistake_is_one_line() -> None:
    empty = mc.Study("pilot", seed=1, description="first try")
    one = empty.group("a", realizations=1, starts=1, fmax=[8.0], amplitude=[5.0], fit={"cost": "ml"})
    assert list(empty.groups) == []
    assert one.groups["a"].fit.cost == "ml"
    assert one.group("b", realizations=1, starts=1, fmax=[8.0], amplitude=[5.0]).fits == 2
    least = {"realizations": 1, "starts": 1, "amplitude": [5.0]}
    for build, line in (
        (lambda: mc.Study("pi lot", seed=1), "name: expected text matching pattern"),
        (lambda: mc.Study("pilot"), "seed: missing"),
        (lambda: one.group("a", realizations=1), "group.a: the study already has a group of this name"),
        (lambda: empty.group("a", fmax=100), "group.a.realizations: missing"),
        (lambda: empty.group("a", fmax="100", **least), "group.a.fmax: expected a list, got '100'"),
        (lambda: empty.group("a", fmax=[100], **least), "group.a.fmax: expected at most 8.005 Hz"),
        (lambda: mc.plan(empty), "group: expected at least one, as Study.group(name, realizations=..."),
        (lambda: mc.run(empty, "nowhere.zarr"), "group: expected at least one"),
    ):
        with pytest.raises(DesignError) as refused:
            build()
        assert str(refused.value).startswith(line)
    assert not Path("nowhere.zarr").exists()


def test_simulate_makes_the_recording_of_the_command(tmp_path: Path) -> None:
    out = tmp_path / "lag.nc"
    words = ["--effect", "sensor_lag_theta1=0.01", "--effect", "stimulus_gain", "--cycles", "3", "--rate", "50"]
    assert main(["simulate", "-o", str(out), *words, "--seed", "4"]) == Exit.DONE
    effects = {"sensor_lag_theta1": 0.01, "stimulus_gain": None}
    ours, theirs = mc.simulate(effects, cycles=3, rate_hz=50.0, seed=4), mc.read_recording(out)
    assert isinstance(theirs, mc.Recording)
    assert [t.theta.tobytes() for t in ours.trials] == [t.theta.tobytes() for t in theirs.trials]
    assert ours.provenance == theirs.provenance
    for build, line in (
        (lambda: mc.simulate(cycles=0), "cycles: expected a number from 1"),
        (lambda: mc.simulate(stimulus="tilt"), "stimulus: expected one of ankle_torque"),
        (lambda: mc.simulate(["no_such_effect"]), "unknown effect 'no_such_effect'"),
        (lambda: mc.simulate(parameters={"K99": 1.0}), "parameter: unknown K99"),
    ):
        with pytest.raises(InputError) as refused:
            build()
        assert str(refused.value).startswith(line)


def test_every_name_is_there_with_a_docstring_and_nothing_else_is_listed() -> None:
    assert dir(mc) == sorted([*mc.__all__, "__doc__"])
    for name in mc.__all__:
        found = getattr(mc, name)
        assert (found.__doc__ or "").strip(), name
    assert mc.effects["passive_damping_ankle"].name == "passive_damping_ankle"
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        mc.nothing  # noqa: B018


def test_importing_it_imports_nothing_heavy() -> None:
    heavy = "('numpy', 'numba', 'xarray', 'dask')"
    code = f"import sys, mcstudy; dir(mcstudy); print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "[]"
