"""Another environment is named, resumed with a word, and never taken for damage; damage is never taken for it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import told

from mcstudy.cli import main
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study import environment
from mcstudy.study.cube import identity, store
from mcstudy.study.cube.checksums import OWN, environments_of, note, noted
from mcstudy.study.cube.store import Cube
from mcstudy.study.extend import Growth, extend
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

ONE = ClusterOptions(workers=1)

ASK = "import json; from mcstudy.study.environment import environment; print(json.dumps(environment()))"


def asked(**variables: str) -> dict[str, Any]:
    """The environment that a process with these variables notes."""
    done = subprocess.run(
        [sys.executable, "-c", ASK], env=os.environ | variables, capture_output=True, text=True, check=True
    )
    return dict(json.loads(done.stdout))


def elsewhere(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> dict[str, Any]:
    """This process in another environment."""
    here = environment.environment() | changes
    for module in ("environment", "cube.store", "cube.repair", "execution.attempt"):
        monkeypatch.setattr(f"mcstudy.study.{module}.environment", lambda: json.loads(json.dumps(here)))
    return here


@pytest.fixture(scope="module")
def other_cube(tmp_path_factory: pytest.TempPathFactory, tiny: str) -> Path:
    """A cube that was made with other linear algebra, whose data differ in the last digits."""
    out = tmp_path_factory.mktemp("elsewhere") / "out.zarr"
    with pytest.MonkeyPatch.context() as patch:
        elsewhere(patch, libc="another 1.0")
        run_study(parse_study(tiny), out, ONE)
    cube = Cube.open(out)
    for group in cube.groups.values():
        for chunk in group.layout.chunks:
            data = {name: group.read(name, chunk) for name in group.layout.results}
            data["frf"] = data["frf"] * (1 + 1e-14)
            group.write(chunk, data)
        (true,) = (out / group.name / "true_frf").glob("c.*")
        spec = group.layout.arrays["true_frf"]
        true.write_bytes(store.encoded(spec, np.asarray(spec.values) * (1 + 1e-14)))
    return out


@pytest.fixture
def copy(tmp_path: Path, other_cube: Path) -> Path:
    return shutil.copytree(other_cube, tmp_path / "out.zarr")


def test_kernels_of_linear_algebra_and_instruction_sets_are_part_of_the_environment() -> None:
    plain, old = asked(), asked(OPENBLAS_CORETYPE="Prescott", OMP_NUM_THREADS="1")
    assert plain["blas"]["numpy"]
    assert plain["libc"]
    assert plain["simd"]
    lines = "\n".join(environment.differences(plain, old))
    assert "settings.OPENBLAS_CORETYPE: unset -> Prescott" in lines
    if "openblas" in plain["blas"]["loaded"] and plain["machine"] == "x86_64":
        assert plain["blas"]["loaded"] != old["blas"]["loaded"]
        assert "blas.loaded: " in lines
    assert environment.label(plain) != environment.label(old)


def test_a_cube_from_elsewhere_is_sound_and_not_reproduced(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = verify(copy, cells=100)
    assert (found.damage, found.beyond) == ([], [])
    assert found.elsewhere.cells > 0
    assert 0 < found.elsewhere.data < 1e-12
    assert found.elsewhere.within
    assert found.notes[0] == f"made in another environment: libc: another 1.0 -> {environment.environment()['libc']}"
    assert "not reproduced here (other environment, within the tolerance)" in told("verify", str(copy))
    document = json.loads(told("verify", str(copy), "--json"))
    schema.validate("verification", document, "verification")
    assert document["other_environment"]["within"]
    assert document["damage"] == []
    assert main(["verify", str(copy), "--tolerance", "1e-15"]) == Exit.DIFFERS
    assert "0 damaged" in capsys.readouterr().out


@pytest.mark.parametrize("array", ["estimate", "cost", "frf", "initial"])
def test_more_than_rounding_is_not_explained_by_another_environment(copy: Path, array: str) -> None:
    group = Cube.open(copy).groups["ideal"]
    (chunk,) = group.layout.chunks
    data = {name: group.read(name, chunk) for name in group.layout.results}
    data[array] = data[array] * 1.001 + (1e-5 if array == "cost" else 0)
    data["estimate"] = np.clip(data["estimate"], group.experiment.model.lower, group.experiment.model.upper)
    group.write(chunk, data)
    found = verify(copy, cells=100)
    assert found.damage == []
    assert any("ideal/status" in line for line in found.beyond)


def test_a_run_leaves_what_another_environment_only_rounded_otherwise(
    copy: Path, tiny: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {file: file.read_bytes() for file in copy.rglob("*") if file.is_file()}
    run_study(parse_study(tiny), copy, ONE)
    assert {file: file.read_bytes() for file in copy.rglob("*") if file.is_file()} == before
    assert "repaired" not in capsys.readouterr().err


def test_a_derived_array_that_is_damaged_or_swapped_is_repaired_from_elsewhere_too(copy: Path, tiny: str) -> None:
    truth, lower = (copy / "ideal" / name / "c.0" for name in ("truth", "lower"))
    truth.write_bytes(lower.read_bytes())  # with its checksum
    (frf,) = (copy / "ideal" / "true_frf").glob("c.*")
    frf.write_bytes(frf.read_bytes()[:-9] + b"123456789")
    assert {line.partition(":")[0] for line in verify(copy, cells=0).damage} == {str(truth), str(frf)}
    run_study(parse_study(tiny), copy, ONE)
    assert verify(copy, cells=0).damage == []


def test_a_resume_elsewhere_warns_in_one_line_and_its_chunks_say_so(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    study, out = parse_study(tiny), tmp_path / "out.zarr"
    run_study(study, out, ONE)
    whole = {file.name: file.read_bytes() for file in (out / "noisy" / "estimate").glob("c.*")}
    group = Cube.open(out).groups["noisy"]
    first, last = group.layout.chunks[0], group.layout.chunks[-1]
    half = {name: group.read(name, last) for name in group.layout.results}
    half["status"][..., :1] = 0
    group.write(last, half)
    group.forget(first)
    capsys.readouterr()
    with monkeypatch.context() as patch:
        there = elsewhere(patch, libc="another 1.0", cpu="abacus")
        run_study(study, out, ONE)
    (line,) = (x for x in capsys.readouterr().err.splitlines() if "another environment" in x)
    assert line.endswith("-> abacus; libc: " + environment.environment()["libc"] + " -> another 1.0")
    name = environment.label(there)
    cube = Cube.open(out)
    group = cube.groups["noisy"]
    assert cube.attributes["environments"] == {name: there}
    assert group.environments(first) == (name,)
    assert group.environments(last) == tuple(sorted((name, OWN)))
    assert all(group.environments(c) == () for c in group.layout.chunks if c not in (first, last))
    assert {file.name: file.read_bytes() for file in (out / "noisy" / "estimate").glob("c.*")} == whole
    found = verify(out, cells=100)
    assert (found.damage, found.beyond, found.elsewhere.cells) == ([], [], 0)  # the bits are the same
    assert any(f"environment {name}: cpu: abacus -> " in x for x in found.notes)

    # Growing it keeps what is known of every cell, and a damaged root is made again from the run log.
    extend(out, Growth(starts=study.groups["noisy"].starts + 1), ONE)
    grown = Cube.open(out)
    assert grown.attributes["environments"] == {name: there}
    assert name in grown.groups["noisy"].environments(first)
    (out / "zarr.json").write_bytes(b"{")
    assert identity.environments(out) == {name: there}
    run_study(grown.study, out, ONE)
    assert Cube.open(out).attributes["environments"] == {name: there}
    assert verify(out, cells=0).damage == []


def test_a_checksum_file_of_the_cube_s_own_environment_is_as_it_was() -> None:
    files = {"a/status/c.0": 7}
    plain, named = note("f" * 64, files), note("f" * 64, files, ["b", OWN])
    assert b"environments" not in plain
    assert environments_of(plain) == ()
    assert environments_of(named) == ("b", OWN)
    for content in (plain, named):
        assert noted(content, "f" * 64, tuple(files)) == files
    with pytest.raises(ValueError, match=r"^$"):
        noted(named.replace(b"environments b", b"environments c"), "f" * 64, tuple(files))


def test_a_fit_from_elsewhere_is_replayed_within_rounding(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = ["--group", "noisy", "--realization", "3", "--start", "2", "--fmax", "1.2", "--amplitude", "5"]
    assert main(["replay", str(copy), *cell]) == Exit.DONE
    printed = " ".join(capsys.readouterr().out.split())
    assert "differs from the stored fit (frf" in printed
    assert "computed in another environment, and differs as rounding explains: data differ by at most 1" in printed
    assert f"environment: libc: another 1.0 -> {environment.environment()['libc']}" in printed
    cube = Cube.open(copy)
    group = cube.groups["noisy"]
    for chunk in group.layout.chunks:
        data = {name: group.read(name, chunk) for name in group.layout.results}
        group.write(chunk, data | {"cost": data["cost"] * (1 + 1e-3)})
    assert main(["replay", str(copy), *cell]) == Exit.DIFFERS
    printed = " ".join(capsys.readouterr().out.split())
    assert "and differs by more than rounding explains" in printed
