"""What cannot be asked of a declared model is refused by every verb in one line that says why, without a traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

import mcstudy as mc
from mcstudy.cli import main

MODEL = """
[model]
name = "servo"
joints = ["motor"]
unit = "V"
stimulus_unit = "A"
term = [{{ order = 2, coefficient = 0.3 }}, {{ gain = "K" }}, {{ gain = "B", order = 1, noisy = true }}, {stimuli}]
parameter = [{{ name = "K", value = {K} }}, {{ name = "B", value = 3.0 }}]
"""
ONE = MODEL.format(stimuli='{ sense = "stimulus" }', K=12.0)
UNSTABLE = MODEL.format(stimuli='{ sense = "stimulus" }', K=-1.0)
TWO = (
    MODEL.format(stimuli='{ sense = "a" }, { sense = "b", gain = "K" }', K=12.0)
    + 'stimulus = [{ name = "a" }, { name = "b" }]\n'
)
GROUP = """
[study]
name = "servo"
seed = 1
[group.one]
realizations = 2
starts = 2
fmax = [8.0]
amplitude = [1.0]
"""
DESIGN = """
[design]
name = "servo"
seed = 1
"""
FILES = {
    "one.toml": ONE,
    "falls.toml": UNSTABLE,
    "two.toml": TWO,
    "study.toml": GROUP + ONE,
    "fallen.toml": GROUP + UNSTABLE,
    "several.toml": GROUP + TWO,
    "three.toml": GROUP + "model.kind = 'three_segment'\n",
    "noisy.toml": GROUP + "noise.psd = [1e-4, 1e-4, 1e-4]\n" + ONE,
    "measured.toml": GROUP + "noise.measurement.sd = [1.0, 1.0, 1.0]\n" + ONE,
    "platform.toml": GROUP + "stimulus.kind = 'surface_tilt'\n" + ONE,
    "applied.toml": GROUP + "stimulus.applied = ['a']\n" + ONE,
    "unknown.toml": GROUP + "model.truth.K11 = 3.0\n" + ONE,
    "product.toml": GROUP + "fit.starts = 'linearised'\n" + ONE.replace('gain = "K"', 'gain = ["K", "B"]'),
    "designed.toml": DESIGN + "criterion = 'difference'\neffects = ['sensor_lag_theta1']\n" + ONE,
    "parameter.toml": DESIGN + "criterion = 'c'\nparameter = 'Td1'\n" + ONE,
    "people.csv": "file,person\nrec.nc,p1\nsecond.nc,p2\n",
}
REFUSED = {
    "models falls.toml --check": "falls.toml: model.parameter: expected a stable closed loop",
    "models elbw": "expected a model file (.toml) or one of",
    "plan fallen.toml": "growth rate +",
    "plan three.toml": "expected 3 numbers, one for each angle",
    "plan noisy.toml": "noise.psd: expected",
    "plan measured.toml": "noise.measurement.sd: expected",
    "plan platform.toml": "stimulus.kind: expected none beside a declared model",
    "run applied.toml -o out.zarr": "stimulus.applied: expected one of stimulus, got 'a'",
    "run unknown.toml -o out.zarr": "model.truth.K11: unknown parameter, expected one of K, B",
    "run product.toml -o out.zarr": "fit.starts: model servo: linearised starts need single gains",
    "extend cube.zarr --amplitude -3": "amplitude",
    "replay cube.zarr --group knee --realization 0 --start 0": "expected one of one",
    "show cube.zarr --compare other.zarr": "parameter: expected K, B",
    "solve study.toml --target cv(K11)<=10% --over cycles": "K11",
    "solve study.toml --model elbw --target cv(K)<=10% --over cycles": "model: expected a model file (.toml) or one of",
    "solve fallen.toml --target cv(K)<=10% --over cycles": "growth rate +",
    "design designed.toml -o d": "design.criterion: expected D, A or c for a declared model",
    "design parameter.toml -o d": "parameter: expected one of K, B",
    "design one.toml -o d": "expected a table [design]",
    "simulate --model falls.toml -o r.nc": "the closed loop is unstable with these parameters",
    "simulate --model one.toml --stimulus surface_tilt -o r.nc": "stimulus",
    "simulate --model one.toml --parameter K11=3 -o r.nc": "K11",
    "simulate --model one.toml --measurement-sd 1 1 -o r.nc": "measurement",
    "fit rec.nc --model elbow": "expected the outputs of model elbow",
    "fit rec.nc --model one_segment": "expected a declared model or two_segment",
    "fit rec.nc --bounds K11=1:2": "K11",
    "fit rec.nc --quantity K11+B": "K11",
    "fit --people people.csv --model elbow": "p1, all: rec.nc: elbow: expected the outputs of model elbow",
    "study-from rec.nc --model elbow -o s.toml": "expected the outputs of model elbow",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files, a recording and two cubes."""
    place = tmp_path_factory.mktemp("servo")
    for name, text in FILES.items():
        (place / name).write_text(text, encoding="utf-8")
    recording = mc.simulate(model=place / "one.toml", cycles=4, rate_hz=50.0, seed=1)
    mc.write_recording(recording, place / "rec.nc")
    mc.write_recording(mc.simulate(model=place / "one.toml", cycles=4, rate_hz=50.0, seed=2), place / "second.nc")
    mc.run(mc.read_study(place / "study.toml"), place / "cube.zarr")
    other = mc.Study("other", seed=1).group("one", model="elbow", realizations=2, starts=1, fmax=[8.0], amplitude=[1.0])
    mc.run(other, place / "other.zarr")
    return place


@pytest.mark.parametrize("words", REFUSED)
def test_a_verb_says_in_one_line_what_it_cannot_do_with_a_model(
    words: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    capsys.readouterr()
    assert main(words.split()) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("mcstudy")
    assert REFUSED[words] in said
    assert not any(word in said.replace(words, "") for word in ("theta", "ankle", "hip ", "Traceback"))
    assert sorted(folder.rglob("*")) == before
