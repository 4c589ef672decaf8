"""Laboratory files from strangers: whatever their bytes, they are read or refused in one line, in little memory."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from c3d_writer import write_c3d
from fuzzing import EDITS, FUZZ, mutated
from hypothesis import given
from hypothesis import strategies as st
from lab_files import write_mat73
from mat5 import HEADER, array, tagged
from scipy.io import savemat

from mcstudy.errors import InputError
from mcstudy.recordings.laboratory_import import import_files

SHEET = {
    "rate_hz": 100.0,
    "units": {"angle": "deg", "stimulus": "N m"},
    "body": {"height": 1.8, "weight": 75.0},
    "channels": {"stimulus": "u", "theta1": "k.x", "theta2": "k.y"},
}

FILES = ("five.mat", "packed.mat", "seven.mat", "a.c3d", "a.csv")


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, rng = tmp_path_factory.mktemp("honest"), np.random.default_rng(0)
    u, x, y = rng.standard_normal((3, 64))
    variables = {"c": [x, y], "u": u, "k": {"x": x, "y": y, "note": "text"}}  # what is needed comes last
    cells = np.empty(2, object)
    cells[:] = [x, y]
    savemat(folder / "five.mat", {**variables, "c": cells})
    savemat(folder / "packed.mat", {**variables, "c": cells}, do_compression=True)
    write_mat73(folder / "seven.mat", variables)
    point = np.column_stack([x, y, 0 * x])
    write_c3d(folder / "a.c3d", {"k": point}, {"u": u}, 100.0, events={"go": [0.1]}, analog_units=["N m"])
    rows = "\n".join(f"{a};{b};{c}" for a, b, c in zip(u, x, y, strict=True))
    (folder / "a.csv").write_text(f"u;k.x;k.y\n(N m);(deg);(deg)\n{rows}\n")
    return folder


def line(path: Path) -> str:
    """What is said of a file, "" when it is read; any other error, and any warning, comes out."""
    units = {"stimulus": "N m", "angle": "deg"} if path.suffix != ".c3d" else {"stimulus": "N m", "angle": "mm"}
    sheet = {**SHEET, "units": units}
    said = ""
    try:
        import_files([path], None, sheet)
    except InputError as error:
        said = str(error)
    assert "\n" not in said
    return said


@pytest.mark.parametrize("name", [n for n in FILES if n != "a.c3d"])
def test_the_honest_files_are_read(honest: Path, name: str) -> None:
    assert line(honest / name) == ""


@pytest.mark.parametrize("name", FILES)
@FUZZ
@given(edits=EDITS)
def test_a_mutated_file_is_read_or_refused_in_one_line(
    tmp_path: Path, honest: Path, name: str, edits: list[tuple[float, bytes, int]]
) -> None:
    content = (honest / name).read_bytes()
    (tmp_path / name).write_bytes(mutated(content, edits, 3000))  # most of the structure is at the front
    line(tmp_path / name)


@pytest.mark.parametrize("name", FILES)
@FUZZ
@given(share=st.floats(0, 1))
def test_a_truncated_file_is_refused(tmp_path: Path, honest: Path, name: str, share: float) -> None:
    content = (honest / name).read_bytes()
    kept = content[: int(share * (len(content) - 600))]
    (tmp_path / name).write_bytes(kept)
    said = line(tmp_path / name)
    assert said or name == "a.csv"  # a shorter text is a shorter recording


@pytest.mark.parametrize("ending", [".mat", ".c3d", ".csv"])
@FUZZ
@given(content=st.binary(max_size=400), header=st.sampled_from(["", "five.mat", "seven.mat", "a.c3d"]))
def test_any_bytes_are_refused_in_one_line(
    tmp_path: Path, honest: Path, ending: str, content: bytes, header: str
) -> None:
    head = (honest / header).read_bytes()[:128] if header else b""
    (tmp_path / f"b{ending}").write_bytes(head + content)
    assert line(tmp_path / f"b{ending}")


def nested(depth: int) -> bytes:
    """Cells in each other, from the inside out, in linear time."""
    inner, parts, size = array(6, (1, 1), b"", tagged(9, bytes(8))), [], 0
    size = len(inner)
    for k in range(depth):
        head = array(1, (1, 1), b"c" if k == depth - 1 else b"", b"")[8:]
        parts.append(struct.pack("<II", 14, len(head) + size) + head)
        size += len(parts[-1])
    return b"".join(reversed(parts)) + inner


def bomb() -> bytes:
    """A gigabyte and more of zeros, compressed."""
    packer = zlib.compressobj(9)
    packed = b"".join(packer.compress(bytes(1 << 24)) for _ in range(70)) + packer.flush()
    return struct.pack("<II", 15, len(packed)) + packed


HOSTILE = {
    "nested cells": lambda: HEADER + nested(100_000),
    "a bomb": lambda: HEADER + bomb(),
    "cells without end": lambda: HEADER + array(1, (2**31 - 1, 2**31 - 1), b"c", b""),
    "numbers that are not there": lambda: HEADER + array(6, (2**31 - 1, 2**30), b"x", tagged(9, bytes(8))),
    "a negative size": lambda: HEADER + array(6, (-1, 3), b"x", tagged(9, bytes(8))),
    "an element longer than the file": lambda: HEADER + struct.pack("<II", 14, 2**32 - 8),
    "fields without names": lambda: HEADER + array(2, (1, 1), b"s", tagged(5, bytes(4)) + tagged(1, b"")),
}

READ_ALL = """
import resource, sys
from pathlib import Path
from mcstudy.errors import InputError
from mcstudy.recordings.laboratory_import import import_files
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
sheet = {"rate_hz": 100.0, "units": {"angle": "deg", "stimulus": "N m"}, "body": {"height": 1.8, "weight": 75.0},
         "channels": {"stimulus": "x", "theta1": "x", "theta2": "x"}}
for path in sys.argv[1:]:
    try:
        import_files([path], None, sheet)
        print("read", flush=True)
    except InputError as error:
        print("refused", str(error).count(chr(10)), path, flush=True)
"""


def test_hostile_files_and_what_is_no_file_are_refused_in_little_memory_and_never_waited_for(
    tmp_path: Path, honest: Path
) -> None:
    """In a process of its own, which may take 3 GB of addresses and is killed after two minutes."""
    paths = []
    for k, make in enumerate(HOSTILE.values()):
        paths.append(tmp_path / f"{k}.mat")
        paths[-1].write_bytes(make())
    for name in FILES:
        for kind in ("pipe", "folder", "zero", "missing"):
            paths.append(tmp_path / f"{kind}_{name}")
            if kind == "pipe":
                os.mkfifo(paths[-1])
            elif kind == "folder":
                paths[-1].mkdir()
            elif kind == "zero":
                paths[-1].symlink_to("/dev/zero")
    with h5py.File(tmp_path / "link.mat", "w") as file:
        file["x"] = h5py.ExternalLink(str(honest / "seven.mat"), "/u")
    with h5py.File(tmp_path / "huge.mat", "w") as file:
        file.create_dataset("x", (10**6, 10**6), "f8", chunks=(1000, 1000))
    with h5py.File(tmp_path / "outside.mat", "w") as file:
        file.create_dataset("x", (100,), "f8", external=[("/etc/passwd", 0, 800)])
    with h5py.File(tmp_path / "circle.mat", "w") as file:
        cell = file.create_dataset("x", (1,), h5py.ref_dtype)
        cell[0] = cell.ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    paths += [tmp_path / f"{n}.mat" for n in ("link", "huge", "outside", "circle")]
    frames = bytearray((honest / "a.c3d").read_bytes())
    frames[8:10] = b"\xff\xff"  # last frame
    (tmp_path / "frames.c3d").write_bytes(frames)
    paths.append(tmp_path / "frames.c3d")
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, *map(str, paths)],
        stdin=subprocess.PIPE,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.stdout.splitlines() == [f"refused 0 {path}" for path in paths], done.stderr[-2000:]
