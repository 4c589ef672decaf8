"""A study of a declared model goes through every verb, in any unit and size, on workers that never saw its package."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from dask_processes import cluster

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import DesignError
from mcstudy.own_model import run_model
from mcstudy.study.study_file import parse_study

STUDY = """
[study]
name = "knee"
seed = 3

[model]
name = "knee"
joints = ["knee"]
unit = "deg"
constants = { J = 0.35 }
term = [
  { order = 2, coefficient = "J" },
  { gain = "K" },
  { gain = "B", order = 1, delay = "Td", noisy = true },
  { sense = "stimulus" },
]
parameter = [
  { name = "K", unit = "N m/deg", value = 12.0 },
  { name = "B", unit = "N m s/deg", value = 3.0 },
  { name = "Td", unit = "s", value = 0.04 },
]
output = [{ name = "flexion", value = "-knee" }]
derived = [{ name = "fn", unit = "Hz", value = "sqrt(K/J)/(2*pi)" }]

[noise]
psd = [1e-4]

[group.one]
realizations = 4
starts = 3
fmax = [1.2, 8.0]
amplitude = [2.0]
"""


def test_every_verb_takes_a_declared_model_with_an_output_and_a_derived_quantity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "knee.toml", str(tmp_path / "knee.zarr")
    file.write_text(STUDY, encoding="utf-8")
    assert main(["plan", str(file)]) == 0
    assert main(["run", str(file), "-o", out]) == 0
    assert main(["run", str(file), "-o", out]) == 0
    assert main(["extend", out, "--realizations", "6"]) == 0
    assert main(["verify", out]) == 0
    cell = ("--group", "one", "--amplitude", "2", "--fmax", "8", "--realization", "5", "--start", "1")
    assert main(["replay", out, *cell]) == 0
    assert main(["report", out, "-o", str(tmp_path / "knee.html")]) == 0
    capsys.readouterr()
    assert main(["show", out, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["groups"]["one"]["cells"][-1]
    assert [(p["name"], p["unit"]) for p in shown["parameters"]] == [
        ("K", "N m/deg"), ("B", "N m s/deg"), ("Td", "s"), ("fn", "Hz"),
    ]  # fmt: skip
    assert shown["realizations"]["used"] == 6
    cube = mc.open_results(out)["one"].to_dataset()
    assert cube["angle"].values.tolist() == ["flexion"]
    s = 2j * np.pi * cube["frequency"].values
    expected = -1 / (0.35 * s**2 + 12 + 3 * s * np.exp(-0.04 * s))
    np.testing.assert_allclose(cube["true_frf"].values[:, 0], expected, rtol=1e-12)
    assert {cube[name].attrs["units"] for name in ("frf", "true_frf")} == {"deg/(N m)"}
    page = (tmp_path / "knee.html").read_text(encoding="utf-8")
    for text in ("flexion", "fn", "Derived quantities"):
        assert text in page


BROUGHT = """
[model]
name = "brought"
joints = ["knee"]
term = [
  { order = 2, coefficient = 0.35 },
  { gain = "K" },
  { gain = "B", order = 1, noisy = true },
  { sense = "stimulus" },
]
parameter = [{ name = "K", value = 12.0 }, { name = "B", value = 3.0 }]
"""


@pytest.mark.slow
def test_a_model_that_a_package_brings_runs_on_a_worker_that_has_no_such_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab = tmp_path / "lab"
    info = lab / "knee_lab-1.0.dist-info"
    info.mkdir(parents=True)
    (lab / "knee_lab.toml").write_text(BROUGHT, encoding="utf-8")
    (lab / "knee_lab.py").write_text("MODEL = __file__.replace('.py', '.toml')\n", encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: knee-lab\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[mcstudy.models]\nbrought = knee_lab:MODEL\n", encoding="utf-8")
    monkeypatch.syspath_prepend(str(lab))  # of this process only
    study = parse_study(
        "[study]\nname = 'lab'\nseed = 1\n[model]\nkind = 'brought'\n"
        "[group.one]\nrealizations = 4\nstarts = 2\nfmax = [8.0]\namplitude = [1.0]\n"
    )
    here = mc.run(study, tmp_path / "here.zarr", workers=1)["one"].to_dataset().load()
    with cluster(tmp_path / "dask") as made:
        made.add_worker()
        made.wait_for(1)
        there = mc.run(study, tmp_path / "there.zarr", scheduler=made.address)["one"].to_dataset().load()
    np.testing.assert_array_equal(there["estimate"], here["estimate"])
    np.testing.assert_allclose(here.mc.best()["estimate"].mean("realization").squeeze(), [12.0, 3.0], rtol=0.05)


def circuit(farad: float, ohm: float) -> mc.Model:
    """A capacitor across a resistor, whose voltage answers a current."""
    return mc.Model(
        name="circuit",
        angles=("voltage",),
        unit="V",
        stimulus_unit="A",
        parameters=(
            mc.Parameter("R", "ohm", ohm, 0.0, 2 * ohm),
            mc.Parameter("C", "F", farad, 0.0, 2 * farad),
        ),
        terms=(
            mc.Term("voltage", "voltage", ("R", "C"), order=1),
            mc.Term("voltage", "voltage"),
            mc.Term("voltage", "stimulus", "R"),
        ),
    )


@pytest.mark.parametrize(("farad", "ohm", "highest"), [(100e-12, 1e6, 5e3), (10.0, 1e-3, 50.0)])
def test_gains_of_any_size_and_frequencies_above_8_hz_are_fitted(farad: float, ohm: float, highest: float) -> None:
    cube = run_model(
        circuit(farad, ohm),
        simulator="none",
        realizations=1,
        starts=10,
        fmax=(highest,),
        amplitude=(1e-3,),
        stimulus={"stages": 4, "state_s": 0.5 / highest, "rate_hz": 8 * highest},
        spectra={"points": "odd_lines", "highest_hz": highest},
    )
    np.testing.assert_allclose(cube.mc.best()["estimate"].values.ravel(), [ohm, farad], rtol=1e-6)
    assert cube["true_frf"].attrs["units"] == "V/(A)"
    assert cube["parameter_unit"].values.tolist() == ["ohm", "F"]


def forty() -> str:
    parameters = ", ".join(f"{{ name = 'K{k}', value = {1.0 + k} }}" for k in range(40))
    terms = ", ".join(f"{{ gain = 'K{k}', order = {k % 3} }}" for k in range(40))
    return (
        "[study]\nname = 'many'\nseed = 1\n[model]\njoints = ['knee']\n"
        f"term = [{{ order = 2 }}, {terms}, {{ sense = 'stimulus' }}]\nparameter = [{parameters}]\n"
        "[group.one]\nrealizations = 1\nstarts = 1\nfmax = [0.2]\namplitude = [1.0]\n"
    )


def test_more_parameters_than_numbers_are_refused_in_one_line() -> None:
    with pytest.raises(DesignError) as refused:
        parse_study(forty())
    assert str(refused.value).startswith("group.one.fmax: expected at least 20 frequencies for 40 parameters, got ")


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            'value = "-knee" }',
            'value = "-knee" }, { name = "flexion", value = "knee" }',
            "model.output.flexion: ",
        ),
        ('value = "-knee"', 'value = "0*knee"', "model.output.flexion.value: "),
        ('name = "fn"', 'name = "K"', "model.derived.K: expected a name of its own"),
        ('{ sense = "stimulus" }', '{ sense = "stimulus", coefficient = 0.0 }', "model.term: expected"),
        ('delay = "Td"', 'delay = "Tx"', "model.term.2.delay: expected the name of a parameter"),
        ("J = 0.35", 'J = "2*J"', "model.constants.J: expected no cycle"),
        ('{ gain = "K" }', "{ coefficient = 12.0 }", "model.parameter.K: expected a parameter that a term holds"),
    ],
)
def test_a_mistake_in_a_study_of_a_declared_model_is_one_line(old: str, new: str, line: str) -> None:
    assert old in STUDY
    with pytest.raises(DesignError) as refused:
        parse_study(STUDY.replace(old, new))
    assert str(refused.value).startswith(f"group.one.{line}")
    assert "\n" not in str(refused.value)
