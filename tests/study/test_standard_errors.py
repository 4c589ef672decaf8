"""Standard errors in a cube: the option, and that they are the same however a chunk was filled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.analysis.show.tables import report_of
from mcstudy.errors import DesignError
from mcstudy.fitting.status import Status
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.cube.store import Cube
from mcstudy.study.execution.tasks import fill
from mcstudy.study.extend import Growth, extend
from mcstudy.study.replay import replay
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

STUDY = """
[study]
name = "errors"
seed = 3

[store]
standard_errors = true

[group.paper]
realizations = 4
starts = 3
fmax = [1.2, 8.0]
amplitude = [500.0]

[group.ml]
realizations = 3
starts = 3
fmax = [8.0]
amplitude = [500.0]

[group.ml.spectra]
points = "odd_lines"
ramp = "remove"

[group.ml.fit]
cost = "ml"
"""


def run(path: Path, text: str = STUDY) -> Path:
    mc.run(mc.read_study(written(path, text)), path / "cube.zarr", workers=1)
    return path / "cube.zarr"


def written(path: Path, text: str) -> Path:
    file = path / "study.toml"
    file.write_text(text)
    return file


def test_without_the_option_a_study_is_what_it_was() -> None:
    off = parse_study(STUDY.replace("= true", "= false"))
    without = parse_study(STUDY.replace("[store]\nstandard_errors = true\n", ""))
    assert off.fingerprint == without.fingerprint
    assert off.to_toml() == without.to_toml()
    assert "store" not in without.to_toml()
    on = parse_study(STUDY)
    assert on.fingerprint != without.fingerprint
    assert parse_study(on.to_toml()).fingerprint == on.fingerprint


@pytest.mark.parametrize("noise", ['simulator = "none"', "noise = { psd = [0.0, 1e-4] }"])
def test_a_group_without_noise_has_none(noise: str) -> None:
    text = STUDY[: STUDY.index("[group.ml]")]
    with pytest.raises(DesignError, match=r"store\.standard_errors: expected false for a group without noise"):
        parse_study(text.replace("[group.paper]", f"[group.paper]\n{noise}"))


def test_a_chunk_filled_in_pieces_holds_the_same_standard_errors(tmp_path: Path) -> None:
    store = Cube.create(tmp_path / "a.zarr", parse_study(STUDY)).groups["paper"]
    chunk = Chunk(0, 0)
    whole = store.layout.empty(chunk)
    fill(store.experiment, store.layout, chunk, whole)
    free = whole["at_bound"][0].any(axis=(2, 3))
    assert np.isfinite(whole["standard_error"][0][~free]).all()
    for stop in range(1, 5):
        pieces, calls = store.layout.empty(chunk), iter(range(100))
        fill(store.experiment, store.layout, chunk, pieces, lambda calls=calls, stop=stop: next(calls) >= stop)
        fill(store.experiment, store.layout, chunk, pieces)
        assert all(pieces[name].tobytes() == whole[name].tobytes() for name in whole)


def test_a_cube_with_them_is_verified_replayed_extended_and_shown(tmp_path: Path) -> None:
    out = run(tmp_path)
    assert verify(out, cells=4).damage == []
    assert replay(out, group="paper", fmax=8.0, realization=1, start=2).differ == ()
    small = mc.open_results(out, lazy=False)
    extend(out, Growth(realizations=5, starts=4, fmax=(3.0,)))
    assert verify(out, cells=4).damage == []
    grown = mc.open_results(out, lazy=False)
    before, after = (t["paper"].to_dataset() for t in (small, grown))
    same = after["standard_error"].sel(fmax=[1.2, 8.0], realization=slice(0, 3))
    unchanged = before.mc.best()["best_start"] == after.mc.best()["best_start"].sel(
        fmax=[1.2, 8.0], realization=slice(0, 3)
    )
    assert bool(unchanged.any())
    np.testing.assert_array_equal(
        before["standard_error"].where(unchanged), same.where(unchanged.assign_coords(same["fmax"].coords))
    )
    assert bool((grown["ml"]["status"] != Status.PENDING).all())
    report = report_of(grown)
    found = report.data["groups"]["ml"]["cells"][0]["parameters"][0]
    performance = grown["ml"].mc.performance().isel(amplitude=0, fmax=0, parameter=0)
    for key, measure in (("coverage", "coverage"), ("se_relative_error", "relative_error"), ("model_se", "model_se")):
        expected = performance.sel(measure=measure)
        assert found[key]["value"] == pytest.approx(float(expected["value"]))
        assert found[key]["used"] == int(expected["n"])
    assert "holds truth %" in report.details()
    low, high = (f"{100 * found['coverage'][end]:.0f}" for end in ("lower", "upper"))
    assert f"{100 * found['coverage']['value']:.0f} [{low}, {high}]" in report.details()
    assert "standard_errors" not in str(report.data["groups"]["ml"]["differences"])
    stable = small["paper"].mc.best(allowed=before["start"] == int(before["start"][-1]))
    others = small["paper"].mc.best()["best_start"] != int(before["start"][-1])
    assert bool(stable["standard_error"].where(others).isnull().all())


def test_standard_errors_of_maximum_likelihood_are_the_scatter_of_the_estimates() -> None:
    study = mc.Study("many", seed=5).group(
        "ml",
        realizations=60,
        starts=1,
        fmax=[8.0],
        amplitude=[300.0],
        spectra={"points": "odd_lines", "ramp": "remove", "covariance": "through_loop"},
        fit={"cost": "ml", "starts": "linearised"},
        store={"standard_errors": True},
    )
    store = Cube(Path(), study, {}, {"ml": 60}).groups["ml"]
    chunk = store.layout.chunks[0]
    data = store.layout.empty(chunk)
    fill(store.experiment, store.layout, chunk, data)
    free = ~data["at_bound"][0, 0, :, 0].any(axis=0)
    assert free.sum() >= 8
    x, se = (v[..., free] for v in (data["estimate"][0, 0, :, 0], data["standard_error"][0, 0]))
    off = np.sqrt((se**2).mean(0)) / x.std(0, ddof=1) - 1
    assert (abs(off) < 3.5 / np.sqrt(2 * 59)).all()
