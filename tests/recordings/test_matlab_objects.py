"""Variables of MATLAB that are no arrays of numbers: listed as what they are, never read as numbers."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse
from lab_files import write_mat73
from mat5 import HEADER, array, tagged
from scipy.io import loadmat, savemat

from mcstudy.cli import main
from mcstudy.errors import RecordingError
from mcstudy.exits import Exit
from mcstudy.recordings.formats import open_source
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.laboratory_import import listing

CLASSES = {
    "table": "S = table2struct(T, 'ToScalar', true); save('numbers.mat', 'S')",
    "timetable": "S = table2struct(timetable2table(T), 'ToScalar', true)",
    "categorical": "S = double(T)",
    "string": "S = double(T)",
    "datetime": "S = seconds(T - T(1))",
    "duration": "S = seconds(T)",
    "timeseries": "S = struct('time', T.Time, 'data', T.Data)",
    "containers.Map": "S = struct(T)",
}


def opaque(name: bytes, category: bytes) -> bytes:
    """An object of a class, as version 5 has it: numbers that stand for what lies elsewhere in the file."""
    inner = array(13, (6, 1), b"", tagged(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1)))
    head = tagged(6, struct.pack("<II", 17, 0)) + tagged(1, name) + tagged(1, b"MCOS") + tagged(1, category)
    return tagged(14, head + inner)


def version5(path: Path, category: str) -> None:
    numbers = array(6, (3, 1), b"u", tagged(9, struct.pack("<3d", 1, 2, 3)))
    elsewhere = array(9, (1, 8), b"", tagged(2, bytes(8)))  # the contents of objects, without a name
    path.write_bytes(HEADER + opaque(b"T", category.encode()) + numbers + elsewhere)


def version73(path: Path, category: str) -> None:
    write_mat73(path, {"u": np.array([1.0, 2.0, 3.0])})
    with h5py.File(path, "a") as file:
        made = file.create_dataset("T", data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], "u4"))
        made.attrs["MATLAB_class"] = np.bytes_(category)
        made.attrs["MATLAB_object_decode"] = np.int32(3)
        file.create_group("#subsystem#").create_dataset("MCOS", data=np.zeros((1, 4), "u4"))


WRITERS = {"5": version5, "7.3": version73}


@pytest.mark.parametrize("version", WRITERS)
@pytest.mark.parametrize("category", CLASSES)
def test_an_object_is_listed_with_what_to_save_instead(tmp_path: Path, version: str, category: str) -> None:
    path = tmp_path / "a.mat"
    WRITERS[version](path, category)
    told = listing(path)
    assert "1 variables" in told
    kind = category if category.isidentifier() else "an object"
    (said,) = [line for line in told.splitlines() if line.startswith("T ")]
    assert kind in said
    assert CLASSES[category] in said
    source = open_source(path, Dialect())
    np.testing.assert_array_equal(source.pick("u").values.ravel(), [1, 2, 3])
    for key in ("T", "T.torque", "T[:,0]"):
        with pytest.raises(RecordingError, match="not an array of numbers; in MATLAB: S = "):
            source.pick(key)


def test_the_files_of_version_5_are_as_scipy_reads_them(tmp_path: Path) -> None:
    version5(tmp_path / "a.mat", "table")
    found = loadmat(tmp_path / "a.mat")["None"]
    assert (found[0]["s0"], found[0]["s1"], found[0]["s2"]) == (b"T", b"MCOS", b"table")


def test_a_command_that_asks_for_a_table_ends_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    version73(tmp_path / "a.mat", "table")
    words = ["--stimulus", "T.torque", "--theta1", "T.leg", "--theta2", "T.trunk", "--rate", "100", "--unit", "deg"]
    words += ["--stimulus-unit", "N m", "--height", "1.8", "--weight", "70", "-o", str(tmp_path / "a.nc")]
    assert main(["import", str(tmp_path / "a.mat"), *words]) == Exit.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert "T is of class table, not an array of numbers; in MATLAB: S = table2struct(T, 'ToScalar', true)" in line


def test_objects_in_structs_and_cells_have_their_place(tmp_path: Path) -> None:
    inner = opaque(b"", b"table")
    cell = array(1, (1, 2), b"c", array(6, (1, 1), b"", tagged(9, struct.pack("<d", 5))) + inner)
    fields = tagged(5, struct.pack("<i", 8)) + tagged(1, b"T\0\0\0\0\0\0\0")
    (tmp_path / "a.mat").write_bytes(HEADER + cell + array(2, (1, 1), b"s", fields + inner))
    source = open_source(tmp_path / "a.mat", Dialect())
    assert list(source.variables) == ["c[0]"]
    assert list(source.others) == ["c[1]", "s.T"]


def sparse73(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("x")
        group.attrs["MATLAB_class"], group.attrs["MATLAB_sparse"] = np.bytes_("double"), np.uint64(3)
        for name, kind in (("data", "f8"), ("ir", "u8"), ("jc", "u8")):
            group[name] = np.ones(3, kind)


def complex73(path: Path) -> None:
    with h5py.File(path, "w") as file:
        pairs = file.create_dataset("x", data=np.zeros((3, 1), [("real", "f8"), ("imag", "f8")]))
        pairs.attrs["MATLAB_class"] = np.bytes_("double")


@pytest.mark.parametrize(
    ("write", "kind"),
    [
        (lambda path: savemat(path, {"x": scipy.sparse.csc_matrix(np.eye(3))}), "sparse"),
        (lambda path: savemat(path, {"x": np.array([1 + 2j, 3])}, do_compression=True), "complex"),
        (sparse73, "sparse"),
        (complex73, "complex"),
    ],
    ids=["sparse 5", "complex 5", "sparse 7.3", "complex 7.3"],
)
def test_sparse_and_complex_arrays_are_not_read_as_their_parts(tmp_path: Path, write: Any, kind: str) -> None:
    write(tmp_path / "a.mat")
    source = open_source(tmp_path / "a.mat", Dialect())
    assert not source.variables
    assert f"x is of class {kind}, not an array of numbers" in source.others["x"]


def test_a_class_of_any_characters_is_one_line(tmp_path: Path) -> None:
    version5(tmp_path / "a.mat", "a\nb\x1b[31m")
    assert all(line.isprintable() for line in listing(tmp_path / "a.mat").splitlines())
