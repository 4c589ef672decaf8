"""Recordings from strangers: nothing outside their folder is read, nothing huge is allocated, nothing is run."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from fuzzing import EDITS, FUZZ, mutated
from hypothesis import given
from hypothesis import strategies as st
from refusals import or_refused

from mcstudy.errors import RecordingError
from mcstudy.files.untrusted import ZSTD_MAGIC
from mcstudy.recordings import recording as limits
from mcstudy.recordings.formats.netcdf_zarr import ANGLES, read_dataset, to_dataset
from mcstudy.recordings.io import read_recording, write_recording
from mcstudy.recordings.recording import Recording, Trial

FORMATS = ("a.nc", "a.zarr", "a")


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One short recording in every format, under the names of `FORMATS`."""
    folder, rng = tmp_path_factory.mktemp("honest"), np.random.default_rng(0)
    trials = tuple(Trial(rng.standard_normal(64), rng.standard_normal((64, 2)), 5.0) for _ in range(2))
    for name in FORMATS:
        write_recording(Recording(trials, 10.0, 1.6), folder / name)
    return folder


@pytest.fixture
def copy(tmp_path: Path, honest: Path) -> Path:
    return shutil.copytree(honest, tmp_path / "copy")


def refused(path: Path, *words: str) -> None:
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    message = str(caught.value)
    assert "\n" not in message
    assert not [word for word in words if word not in message], message


@pytest.mark.parametrize("name", ["../secret.csv", "/etc/hostname", "link.csv", "a/../../secret.csv", "x\0y"])
def test_a_sheet_names_no_file_outside_its_folder(copy: Path, name: str) -> None:
    sheet = copy / "a" / "recording.toml"
    (copy / "secret.csv").write_text("time,stimulus,theta1,theta2\n0,1,2,3\n")
    (copy / "a" / "link.csv").symlink_to(copy / "secret.csv")
    sheet.write_text(sheet.read_text().replace('"trial1.csv"', json.dumps(name)))
    refused(sheet, "expected a name inside")


def test_a_sheet_of_endless_keys_is_refused(copy: Path) -> None:
    sheet = copy / "a" / "recording.toml"
    sheet.write_text("a" + ".a" * 200_000 + " = 1")
    refused(sheet, "keys of at most")


def soft(file: h5py.File) -> None:
    del file["theta"]
    file["theta"] = h5py.SoftLink("/stimulus")


def external_link(file: h5py.File) -> None:
    del file["theta"]
    file["theta"] = h5py.ExternalLink("other.nc", "/theta")


def external_bytes(file: h5py.File) -> None:
    del file["theta"]
    file.create_dataset("theta", (2, 64, 2), "f8", external=[("/etc/passwd", 0, 2048)])


def virtual(file: h5py.File) -> None:
    del file["theta"]
    layout = h5py.VirtualLayout((2, 64, 2), "f8")
    layout[:] = h5py.VirtualSource("other.nc", "theta", (2, 64, 2))
    file.create_virtual_dataset("theta", layout)


def huge_time(file: h5py.File) -> None:
    del file["time"]
    file.create_dataset("time", (10**12,), "f8", chunks=(1000,))


def huge_chunk(file: h5py.File) -> None:
    del file["samples"]
    file.create_dataset("samples", (2,), "f8", chunks=(2**28 + 1,), maxshape=(None,))


def huge_string(file: h5py.File) -> None:
    del file["angle"]
    file.create_dataset("angle", (2,), "S2000000000", chunks=(1,))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (soft, "link"),
        (external_link, "link"),
        (external_bytes, "reference"),
        (virtual, "reference"),
        (huge_time, "declares"),
        (huge_chunk, "declares"),
        (huge_string, "declares"),
    ],
)
def test_a_netcdf_file_that_refers_elsewhere_or_claims_too_much_is_refused(
    copy: Path, change: Callable[[h5py.File], None], word: str
) -> None:
    with h5py.File(copy / "a.nc", "a") as file:
        change(file)
    refused(copy / "a.nc", word)


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("codecs", [{"name": "bytes"}, {"name": "gzip", "configuration": {"level": 1}}], "codecs"),
        ("codecs", [{"name": "numcodecs.pickle"}], "codecs"),
        ("shape", [10**12], "declares"),
        ("data_type", "object", "data_type"),
        ("data_type", {"name": "fixed_length_utf32", "configuration": {"length_bytes": 2**40}}, "declares"),
        ("chunk_grid", {"name": "regular", "configuration": {"chunk_shape": [2**40]}}, "declares"),
        ("shape", [-1], "shape: expected whole numbers"),
        ("shape", ["64"], "shape: expected whole numbers"),
        ("shape", [2.5], "shape: expected whole numbers"),
        ("shape", None, "shape: expected whole numbers"),
        ("shape", [True], "shape: expected whole numbers"),
        ("shape", [1] * 40, "as long as shape"),
        ("chunk_grid", {"name": "regular", "configuration": {"chunk_shape": [0]}}, "chunk_shape: expected whole"),
        ("chunk_grid", {"name": "rectilinear", "configuration": {"chunk_shape": [64]}}, "chunk_grid: expected regular"),
        ("chunk_grid", "regular", "chunk_shape: expected whole numbers"),
        ("codecs", [{"name": "sharding_indexed", "configuration": {"chunk_shape": [1]}}], "codecs"),
        ("codecs", [{"name": "bytes"}, *[{"name": "zstd"}] * 50], "codecs"),
        ("codecs", [{"name": "zstd"}, {"name": "bytes"}], "codecs"),
        ("codecs", [{"name": ["bytes"]}], "codecs"),
        ("codecs", "bytes", "codecs"),
        ("codecs", None, "codecs"),
        ("data_type", "complex128", "data_type"),
        ("data_type", {"name": "fixed_length_utf32", "configuration": {"length_bytes": -4}}, "data_type"),
        ("data_type", {"name": "fixed_length_utf32"}, "data_type"),
        ("data_type", {"name": "structured", "configuration": {"fields": [["a", "float64"]]}}, "data_type"),
        ("dimension_names", None, "dimension_names"),
        ("dimension_names", "t", "dimension_names"),
        ("chunk_key_encoding", {"name": "default", "configuration": {"separator": "../../"}}, "separator"),
        ("chunk_key_encoding", None, "chunk_key_encoding"),
        ("storage_transformers", [{"name": "x"}], "storage_transformers"),
        ("node_type", "group", "node_type: expected 'array'"),
        ("zarr_format", 2, "zarr_format: expected 3"),
        ("zarr_format", "3", "zarr_format: expected 3"),
        ("attributes", [1], "attributes: expected 'dict'"),
    ],
)
def test_a_zarr_store_with_other_codecs_or_that_claims_too_much_is_refused(
    copy: Path, key: str, value: object, word: str
) -> None:
    file = copy / "a.zarr" / "time" / "zarr.json"
    document = json.loads(file.read_text())
    document[key] = value
    file.write_text(json.dumps(document))
    refused(copy / "a.zarr", word)


@pytest.mark.parametrize(
    ("array", "text", "word"),
    [
        ("", '{"attributes":' + "[" * 100_000 + "]" * 100_000 + "}", "nesting"),
        ("stimulus", '{"shape":' + "[" * 100_000 + "]" * 100_000 + "}", "nesting"),
        ("stimulus", "[]", "expected a JSON object"),
        ("stimulus", '{"shape": NaN}', "finite"),
        ("stimulus", "", "expected JSON"),
        ("", '{"zarr_format": 3, "node_type": "group", "attributes": "x"}', "attributes: expected 'dict'"),
        ("extra", '{"zarr_format": 3, "node_type": "group", "attributes": {}}', "node_type: expected 'array'"),
    ],
)
def test_zarr_metadata_that_are_none_are_refused(copy: Path, array: str, text: str, word: str) -> None:
    (copy / "a.zarr" / array).mkdir(exist_ok=True)
    (copy / "a.zarr" / array / "zarr.json").write_text(text)
    refused(copy / "a.zarr", word)


@pytest.mark.parametrize("name", ["a.nc", "a.zarr", "a.h5"])
@pytest.mark.parametrize("content", [gzip.compress(bytes(1 << 20)), b"PK\x03\x04" + bytes(1000)], ids=["gzip", "zip"])
def test_a_packed_file_under_another_name_is_refused(copy: Path, name: str, content: bytes) -> None:
    path = copy / "packed" / name
    path.parent.mkdir()
    path.write_bytes(content)
    refused(path, name)


@pytest.mark.parametrize("packed", [None, "gzip"])
def test_a_netcdf_file_of_samples_that_are_nowhere_is_refused_before_they_are_made(
    copy: Path, packed: str | None
) -> None:
    """Chunks that were never written are all the same value: a file of 20 kB with 1.5 GB of numbers."""
    with h5py.File(copy / "a.nc", "a") as file:
        length = 30_000_000
        for name, shape in {"time": (length,), "stimulus": (2, length), "theta": (2, length, 2)}.items():
            del file[name]
            made = file.create_dataset(name, shape, "f8", chunks=(1,) * (len(shape) - 1) + (2,), compression=packed)
            made.attrs["units"] = {"time": "s", "stimulus": "N m", "theta": "rad"}[name]
        file["time"].make_scale("time")
        for name, dims in {"stimulus": ("trial", "time"), "theta": ("trial", "time", "angle")}.items():
            for k, dim in enumerate(dims):
                file[name].dims[k].attach_scale(file[dim])
    assert (copy / "a.nc").stat().st_size < 100_000
    refused(copy / "a.nc", "samples in all, got 60000000")


def test_a_zarr_store_with_a_link_or_a_bomb_in_it_is_refused(copy: Path) -> None:
    store = copy / "a.zarr"
    (chunk,) = [p for p in (store / "stimulus" / "c").rglob("*") if p.is_file()]
    chunk.write_bytes(ZSTD_MAGIC + bytes([0b1110_0000]) + (1 << 50).to_bytes(8, "little") + bytes(8))
    refused(store, "expected a chunk of at most")
    chunk.unlink()
    chunk.symlink_to("/dev/zero")
    refused(store)
    (store / "theta").rename(copy / "elsewhere")
    (store / "theta").symlink_to(copy / "elsewhere")
    refused(store, "link")


def test_a_zarr_v2_store_is_refused(copy: Path) -> None:
    shutil.rmtree(copy / "a.zarr")
    (copy / "a.zarr").mkdir()
    (copy / "a.zarr" / ".zgroup").write_text('{"zarr_format": 2}')
    refused(copy / "a.zarr")


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def standard_input(path: Path) -> None:
    path.symlink_to("/dev/stdin")


def listening_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as s:
        here = Path.cwd()
        os.chdir(path.parent)  # the name of a socket may have no more than about a hundred characters
        try:
            s.bind(path.name)
        finally:
            os.chdir(here)


def folder(path: Path) -> None:
    path.mkdir()


REPLACED = {
    "a.nc": "a.nc",
    "a.h5": "a.h5",
    "a/recording.toml": "a/recording.toml",
    "a/trial1.csv": "a/recording.toml",
    "a/recording.toml beside a table": "a/recording.csv",
    "a.zarr": "a.zarr",
    "a.zarr/stimulus/zarr.json": "a.zarr",
    "a.zarr/stimulus/c/0/0": "a.zarr",
}
"""What is replaced by something else, and what is read then."""

READ_ALL = """
import resource, sys
from mcstudy.errors import RecordingError
from mcstudy.recordings.io import read_recording
resource.setrlimit(resource.RLIMIT_AS, (1 << 33, 1 << 33))
for path in sys.argv[1:]:
    try:
        print("read", path, read_recording(path), flush=True)
    except RecordingError as error:
        print("refused", path, error, flush=True)
"""


def test_what_is_no_regular_file_is_refused_and_never_waited_for(tmp_path: Path, honest: Path) -> None:
    """In a process of its own: a library that waits for the writer of a pipe can only be killed."""
    reads = []
    for make in (pipe, device, standard_input, listening_socket, folder):
        for k, (replaced, read) in enumerate(REPLACED.items()):
            own = shutil.copytree(honest, tmp_path / make.__name__ / str(k))
            (own / "a" / "recording.csv").touch()
            path = own / replaced.split(" ")[0]
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
            make(path)
            reads.append(str(own / read))
    command = [sys.executable, "-c", READ_ALL, *reads]
    # Its standard input stays open, so that reading it would wait, too.
    with (
        (tmp_path / "said").open("w+") as said,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said) as process,
    ):
        try:
            process.wait(120)
        except subprocess.TimeoutExpired:
            process.kill()
        lines = (tmp_path / "said").read_text().splitlines()
    assert [line.split(" ")[:2] for line in lines] == [["refused", read] for read in reads]


def many_chunks(path: Path) -> list[Path]:
    """A store of several hundred chunks; returns those of the stimulus."""
    rng = np.random.default_rng(0)
    trials = tuple(Trial(rng.standard_normal(2000), rng.standard_normal((2000, 2)), 5.0) for _ in range(4))
    dataset = to_dataset(Recording(trials, 10.0, 50.0)).drop_vars("angle").assign_attrs(angles=list(ANGLES))
    encoding = {"stimulus": {"chunks": (1, 40)}, "theta": {"chunks": (1, 40, 2)}}
    dataset.to_zarr(path, mode="w", zarr_format=3, consolidated=False, encoding=encoding)
    return sorted(p for p in (path / "stimulus" / "c").rglob("*") if p.is_file())


def linked(chunk: Path) -> None:
    chunk.unlink()
    chunk.symlink_to("/dev/zero")


def cut(chunk: Path) -> None:
    chunk.write_bytes(chunk.read_bytes()[:-9])


@pytest.mark.parametrize(("damage", "word"), [(linked, "link"), (cut, "decoded")])
def test_a_damaged_store_of_many_chunks_gets_one_line_and_no_noise_behind_it(
    tmp_path: Path, damage: Callable[[Path], None], word: str
) -> None:
    for chunk in many_chunks(tmp_path / "many.zarr")[::3]:
        damage(chunk)
    command = [sys.executable, "-m", "mcstudy", "gap", "diagnose", "--fast", str(tmp_path / "many.zarr")]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert ran.returncode == 2
    assert len(ran.stderr.splitlines()) == 1, ran.stderr[:2000]
    assert word in ran.stderr


def test_a_store_of_many_honest_chunks_is_read(tmp_path: Path) -> None:
    many_chunks(tmp_path / "many.zarr")
    assert len(read_dataset(tmp_path / "many.zarr").trials) == 4


def test_a_recording_of_endless_trials_is_refused_before_they_are_read(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet = copy / "a" / "recording.toml"
    head = sheet.read_text().split("\n[[trials]]")[0]
    sheet.write_text(head + '\n[[trials]]\nfile = "trial1.csv"\n' * 20_000)
    refused(sheet, "trials: expected at most 1000, got 20000")
    sheet.write_text(head + '\n[[trials]]\nfile = "trial1.csv"\n' * 3)
    monkeypatch.setattr(limits, "MOST_SAMPLES", 100)
    refused(sheet, "trials: expected at most 100 samples in all, got 128")
    refused(copy / "a.nc", "samples in all, got 128")
    refused(copy / "a.zarr", "samples in all, got 128")
    monkeypatch.setattr(limits, "MOST_TRIALS", 1)
    refused(copy / "a.nc", "trials: expected at most 1, got 2")


@pytest.mark.parametrize("name", FORMATS)
@FUZZ
@given(which=st.integers(0, 100), edits=EDITS)
def test_a_mutated_recording_is_read_or_refused_in_one_line(
    copy: Path, honest: Path, name: str, which: int, edits: list[tuple[float, bytes, int]]
) -> None:
    source = honest / name
    files = sorted(p for p in source.rglob("*") if p.is_file()) if source.is_dir() else [source]
    file = files[which % len(files)]
    target = copy / file.relative_to(honest)
    target.write_bytes(mutated(file.read_bytes(), edits))
    or_refused(lambda: read_recording(copy / name if name != "a" else copy / "a" / "recording.toml"))
    target.write_bytes(file.read_bytes())


@pytest.mark.parametrize("name", ["b.nc", "b.toml", "b.csv", "b.zarr/zarr.json"])
@FUZZ
@given(content=st.binary(max_size=400) | st.text(max_size=200).map(str.encode))
def test_any_bytes_are_refused_in_one_line(copy: Path, name: str, content: bytes) -> None:
    file = copy / name
    file.parent.mkdir(exist_ok=True)
    shutil.copy(copy / "a" / "recording.toml", copy / "b.toml")
    file.write_bytes(content)
    or_refused(lambda: read_recording(copy / name.split("/")[0]))


keys = st.sampled_from(
    [
        "name",
        "rate_hz",
        "period_s",
        "stimulus",
        "convention",
        "units",
        "body",
        "trials",
        "frf",
        "file",
        "column",
        "J1",
        "g",
    ]
)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just("trial1.csv"),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(keys, inner, max_size=3),
    max_leaves=6,
)


def literal(value: object) -> str:
    """TOML for a JSON-like value."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {literal(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(literal, value)) + "]"
    return "0" if value is None else json.dumps(value).replace("NaN", "nan").replace("Infinity", "inf")


@FUZZ
@given(sheet=st.dictionaries(keys, values, max_size=6))
def test_any_sheet_is_read_or_refused_in_one_line(copy: Path, sheet: dict[str, object]) -> None:
    honest = (copy / "a" / "recording.toml").read_text().split("\n[[trials]]")[0].splitlines()
    kept = [line for line in honest if line.split(" ")[0] not in sheet]
    file = copy / "a" / "sheet.toml"
    trials = "" if "trials" in sheet else '\n[[trials]]\nfile = "trial1.csv"\n'
    file.write_text("\n".join([*kept, *(f"{k} = {literal(v)}" for k, v in sheet.items())]) + trials)
    or_refused(lambda: read_recording(file))
