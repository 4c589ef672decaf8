"""Settings as axes: the cells of a sweep are groups, whose results are one array with the axes as dimensions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.errors import DesignError, InputError
from mcstudy.study.cube.store import Cube
from mcstudy.study.growth import growths
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

GROUP: dict[str, Any] = {
    "realizations": 3,
    "starts": 1,
    "fmax": [3.0],
    "amplitude": [5.0],
    "stimulus": {"stages": 4, "state_s": 0.05, "rate_hz": 100.0},
    "fit": {"starts": "linearised"},
    "spectra": {"points": "odd_lines"},
}
DAMPING = "passive_damping_ankle"


def study(sweep: dict[str, Any], **changes: Any) -> mc.Study:
    made: mc.Study = mc.Study("swept", seed=5).group("s", **GROUP, sweep=sweep, **changes)
    return made


def test_every_combination_is_a_group_with_the_settings_written_out() -> None:
    made = study({"effect": ["head_mode", DAMPING], "size": ["low", "high"], "cycles": [3, 6]})
    assert len(made.groups) == 8
    cell = made.groups["s--head_mode--high--3"]
    assert cell.stimulus.cycles == 3
    assert cell.effects.truth == {"head_mode": {"m_head": 6.0, "f_head": 2.75}}
    assert made.groups[f"s--{DAMPING}--low--6"].effects.truth == {DAMPING: 11.0}
    assert parse_study(made.to_toml()).fingerprint == made.fingerprint
    assert mc.Study.from_json(made.to_json()).fingerprint == made.fingerprint


def test_a_cell_has_the_bits_of_the_same_group_without_a_sweep(tmp_path: Path) -> None:
    made = study({f"effects.truth.{DAMPING}": [10.0, 20.0], "cost": ["paper", "ml"]})
    alone = made.groups["s--20p0--ml"].model_dump(mode="json", exclude={"cell"})
    swept = mc.run(made, tmp_path / "swept.zarr", workers=1)["s"].to_dataset()
    group = mc.run(mc.Study("one", seed=5).group("g", **alone), tmp_path / "one.zarr", workers=1)["g"].to_dataset()
    cell = swept.sel({DAMPING: 20.0, "cost_setting": "ml"})
    for name in ("estimate", "cost", "frf", "truth", "status"):
        np.testing.assert_array_equal(cell[name].values, group[name].values)
    np.testing.assert_array_equal(cell.mc.bias()["value"].values, group.mc.bias()["value"].values)


def test_statistics_have_the_axes_as_dimensions_and_are_those_of_each_cell(tmp_path: Path) -> None:
    fits: dict[str, Any] = {"none": [], "both": [DAMPING]}
    made = study({"effect": ["head_mode", DAMPING], "size": [2.0, 5.0], "effects.fit": fits})
    tree = mc.run(made, tmp_path / "cube.zarr", workers=1)
    bias = tree["s"].mc.bias()
    assert bias["value"].dims == ("effect", "size", "fit", "amplitude", "fmax", "parameter")
    at = {"effect": DAMPING, "size": 5.0, "fit": "both"}
    data = tree["s"].to_dataset().sel(at)
    mean = data.mc.best()["estimate"].squeeze().mean("realization")
    np.testing.assert_allclose(bias["value"].sel(at).squeeze(), mean - data["truth"])
    assert float(data["truth"].sel(parameter="Bpas1")) == 5.0
    assert np.isnan(bias["value"].sel(fit="none", parameter="Bpas1")).all()
    assert str(bias["parameter_unit"].sel(parameter="Bpas1").item()) == "N m s/rad"
    assert tree["s"].mc.best().mc.sd()["value"].sizes["size"] == 2
    assert verify(tmp_path / "cube.zarr", cells=2).damage == []


def test_all_cells_share_the_noise_of_a_realization_and_realizations_do_not(tmp_path: Path) -> None:
    tree = mc.run(study({"cost": ["paper", "ml"], "upper": [2.0, 3.0]}), tmp_path / "cube.zarr", workers=1)
    responses = tree["s"]["frf"].values.reshape(4, 3, -1)
    np.testing.assert_array_equal(responses[0], responses[3])
    assert len(np.unique(responses[0][:, 0])) == 3


def test_a_realization_with_the_random_numbers_of_another_is_damage(tmp_path: Path) -> None:
    mc.run(study({"cycles": [3, 6]}), tmp_path / "cube.zarr", workers=1)
    store = Cube.open(tmp_path / "cube.zarr").groups["s--6"]
    (chunk,) = store.layout.chunks
    data = store.held(chunk)
    data["frf"][0, 2] = data["frf"][0, 1]
    store.write(chunk, data)
    damage = verify(tmp_path / "cube.zarr", cells=0).damage
    assert [line.split(": ", 1)[1] for line in damage] == [
        "expected noise of its own in every realization, found the data of 1 in 2"
    ]


def test_a_combination_may_be_left_out(tmp_path: Path) -> None:
    made = study({"cost": ["paper", "ml"], "cycles": [3, 6], "skip": [{"cost": "ml", "cycles": 3}]})
    assert len(made.groups) == 3
    data = mc.run(made, tmp_path / "cube.zarr", workers=1)["s"].to_dataset()
    bias = data.mc.bias()["value"]
    assert np.isnan(bias.sel(cost_setting="ml", cycles=3)).all()
    assert np.isfinite(bias.sel(cost_setting="ml", cycles=6)).any()
    with pytest.raises(InputError, match="left out"):
        data.sel(cost_setting="ml", cycles=3).mc.bias()


def test_extending_an_axis_runs_the_new_cells_alone(tmp_path: Path) -> None:
    small, large = (study({"effect": [DAMPING], "size": sizes}) for sizes in ([10.0], [10.0, 30.0]))
    before = mc.run(small, tmp_path / "cube.zarr", workers=1)["s"].to_dataset()
    (growth,) = growths(small, large) or []
    assert growth.command(Path("cube")) == "mcstudy extend cube --sweep size=30.0"
    after = mc.extend(tmp_path / "cube.zarr", sweep={"size": [30.0]})["s"].to_dataset()
    np.testing.assert_array_equal(after["estimate"].sel(size=10.0), before["estimate"].sel(size=10.0))
    assert np.isfinite(after["estimate"].sel(size=30.0)).all()
    assert after.attrs["fingerprint"] == large.fingerprint
    assert verify(tmp_path / "cube.zarr", cells=2).damage == []


def test_a_sweep_of_models_fits_each(tmp_path: Path) -> None:
    tree = mc.run(
        study({"model": {"one": {"kind": "one_segment"}, "two": {"kind": "two_segment"}}}),
        tmp_path / "c.zarr",
        workers=1,
    )
    bias = tree["s"].mc.bias()["value"]
    assert np.isnan(bias.sel(model="one", parameter="K22")).all()
    assert int(np.isfinite(bias.sel(model="one")).sum()) == 4
    assert int(np.isfinite(bias.sel(model="two")).sum()) == 12


REFUSED = [
    ({"cylces": [3, 6]}, "group.s.sweep.cylces: unknown setting (similar: cycles)"),
    ({"effect": ["head_mod"], "size": [1.0]}, "group.s.sweep.effect: unknown effect (similar: head_mode)"),
    ({"effect": ["head_mode"]}, "group.s.sweep.effect: expected the axis effect beside either size or delta"),
    ({"effect": ["head_mode"], "size": ["large"]}, "group.s.sweep.size: expected numbers, or low, middle, high, got"),
    ({"cycles": []}, "group.s.sweep.cycles: expected at least one value"),
    ({"cycles": [3, 3]}, "group.s.sweep.cycles: expected every value listed once"),
    ({"cycles": [3, "many"]}, "group.s--many.stimulus.cycles: expected a whole number, got 'many'"),
    ({"fmax": [3.0]}, "group.s.sweep.fmax: expected a setting that is no axis of a group already"),
    ({"cycles": [3], "skip": [{"cycle": 3}]}, "group.s.sweep.skip.cycle: unknown axis (similar: cycles), expected one"),
    ({"noise": [1, 2]}, "group.s--1.noise: expected a table, got 1"),
]


@pytest.mark.parametrize(("sweep", "line"), REFUSED)
def test_what_is_no_axis_is_refused_with_the_nearest_name(sweep: dict[str, Any], line: str) -> None:
    with pytest.raises(DesignError) as refused:
        study(sweep)
    assert str(refused.value).startswith(line)


def test_an_unknown_axis_of_an_extension_is_refused_with_the_nearest_name(tmp_path: Path) -> None:
    mc.run(study({"cycles": [3]}), tmp_path / "cube.zarr", workers=1)
    with pytest.raises(DesignError, match=r"^sweep\.cycle: unknown axis \(similar: cycles\), expected one of cycles$"):
        mc.extend(tmp_path / "cube.zarr", sweep={"cycle": [6]})
