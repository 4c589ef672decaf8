"""What a stranger made is refused in one line before it costs memory, leaves its folder, or runs anything."""

from __future__ import annotations

import ast
import json
import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from google_crc32c import value as crc32c
from json_edits import edit
from numcodecs import zstd

from mcstudy.analysis.results import open_results
from mcstudy.errors import DesignError, StoreError
from mcstudy.files import untrusted
from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

PACKAGE = Path(untrusted.__file__).parents[1]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, tiny: str) -> Path:
    out = tmp_path_factory.mktemp("untrusted") / "out.zarr"
    run_study(parse_study(tiny), out, ClusterOptions(workers=1))
    return out


@pytest.fixture
def copy(tmp_path: Path, sound: Path) -> Path:
    return shutil.copytree(sound, tmp_path / "out.zarr")


def refused(work: Callable[[], object], *words: str) -> str:
    """The one line with which something is refused."""
    with pytest.raises((StoreError, DesignError)) as caught:
        work()
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 1000
    assert not [word for word in words if word not in message], message
    return message


GREEDY = [
    ("starts = 6", "starts = 1_000_000\nfit.solver = 'trf'", "group.noisy.starts: expected a chunk of at most"),
    (
        "fmax = [0.41, 1.2]",
        f"fmax = [{', '.join(str(0.5 + k / 200) for k in range(1000))}]\nfit.starts = 'sobol'",
        "group.noisy.starts: expected a chunk of at most",
    ),
    ("realizations = 5", "realizations = 10_000_000", "group.noisy.realizations: expected at most"),
    ("amplitude = [3.0, 5.0]", "amplitude = [5.0]\nstimulus.cycles = 100_000", "group.noisy.stimulus.cycles: expected"),
    (
        "amplitude = [3.0, 5.0]",
        "amplitude = [5.0]\nspectra.points = 'odd_lines'\n"
        "stimulus = {stages = 9, state_s = 0.1, cycles = 1, discard = 0}",
        "group.noisy.stimulus.state_s: expected at most",
    ),
    ("amplitude = [3.0, 5.0]", "amplitude = [5.0]\nstimulus.rate_hz = 1e300", "group.noisy.stimulus.rate_hz: expected"),
    (
        "amplitude = [3.0, 5.0]",
        "amplitude = [5.0]\nstimulus = {rate_hz = 1e6, state_s = 1e3}",
        "group.noisy.stimulus.state_s: expected at most",
    ),
    ("amplitude = [3.0, 5.0]", "amplitude = [5.0]\nstimulus.state_s = 1e9", "group.noisy.stimulus.state_s: expected"),
]


@pytest.mark.parametrize(("old", "new", "expected"), GREEDY)
def test_a_study_that_asks_for_too_much_is_refused_before_it_is_planned(
    tiny: str, old: str, new: str, expected: str
) -> None:
    text = tiny.replace(old, new, 1)
    if "1_000_000" in new or "fmax" in old:
        text = text.replace("starts = 6", "starts = 5000").replace("fmax = [0.41, 1.2]", "fmax = [0.41, 1.2, 8.0]")
    if "10_000_000" in new:
        text = text.replace("starts = 6", "starts = 5000")
    refused(lambda: parse_study(text), expected, "got")


@pytest.mark.parametrize(
    "text",
    [
        "a" + ".a" * 100_000 + " = 1",
        "a = " + "[" * 100_000,
        "a = " + "9" * 5000,
        "x = 1\n" * 2,
        "#" * 1_000_001,
        "".join(f"[group.g{k}]\nrealizations=1\nstarts=1\nfmax=[8.0]\namplitude=[5.0]\n" for k in range(1001))
        + "[study]\nname='many'\nseed=1\n",
    ],
)
def test_text_that_nests_or_repeats_without_end_is_one_line(text: str) -> None:
    refused(lambda: parse_study(text))


METADATA = [
    ("noisy/estimate", edit("shape", [2, 2, 10**9, 6, 12]), "shape"),
    ("noisy/estimate", edit("chunk_grid.configuration.chunk_shape", [1, 2, 10**9, 6, 12]), "chunk_grid"),
    ("noisy/status", edit("shape", [2, 2, 4, 6]), "shape"),
    ("noisy/cost", edit("data_type", "complex128"), "data_type"),
    ("noisy/cost", edit("codecs", [{"name": "bytes"}, {"name": "gzip"}]), "codecs"),
    ("noisy/cost", edit("codecs", [{"name": "numcodecs.pickle"}]), "codecs"),
    ("noisy/cost", edit("chunk_key_encoding.configuration.separator", "/"), "chunk_key_encoding"),
    ("noisy/cost", edit("storage_transformers", [{"name": "x"}]), "storage_transformers"),
    ("noisy/parameter", edit("shape", [10**9]), "shape"),
    ("noisy", edit("attributes.realizations_a_chunk", 10**7), ""),
    ("noisy", edit("attributes.design", {}), "design"),
]


@pytest.mark.parametrize(("folder", "change", "field"), METADATA)
def test_metadata_that_is_not_that_of_the_study_is_refused_before_an_array_is_read(
    copy: Path, folder: str, change: Callable[[Path], None], field: str
) -> None:
    change(copy / folder / "zarr.json")
    refused(lambda: open_results(copy), field)


def as_link(path: Path) -> None:
    root = next(p for p in path.parents if p.name == "out.zarr").parent
    elsewhere = root / f"elsewhere-{path.name}"
    path.rename(elsewhere)
    path.symlink_to(elsewhere)


@pytest.mark.parametrize("inside", ["noisy", "noisy/estimate", "noisy/estimate/zarr.json", "noisy/zarr.json"])
def test_a_link_inside_a_cube_is_refused_by_every_reader_and_not_written_through(
    copy: Path, tiny: str, inside: str
) -> None:
    as_link(copy / inside)
    outside = tree_digest(copy.parent)
    for work in (
        lambda: open_results(copy),
        lambda: Cube.open(copy),
        lambda: verify(copy),
        lambda: run_study(parse_study(tiny), copy, ClusterOptions(workers=1)),
    ):
        refused(work, "link")
    shutil.rmtree(copy.with_name("out.zarr.log"))
    assert tree_digest(copy.parent) == outside


@pytest.mark.parametrize("target", ["/dev/zero", "same"])
def test_a_chunk_that_is_a_link_is_damage_and_is_replaced_not_followed(copy: Path, tiny: str, target: str) -> None:
    store = Cube.open(copy).groups["noisy"]
    file = store.chunk_file("cost", store.layout.chunks[0])
    before, honest = tree_digest(copy), file.read_bytes()
    if target == "same":
        as_link(file)
    else:
        file.unlink()
        file.symlink_to(target)
    assert [line for line in verify(copy, cells=0).damage if str(file) in line and "link" in line]
    refused(lambda: open_results(copy)["noisy"]["cost"].compute(), str(file))
    run_study(parse_study(tiny), copy, ClusterOptions(workers=1))
    assert not file.is_symlink()
    assert file.read_bytes() == honest
    assert tree_digest(copy) == before


def test_a_pipe_in_place_of_a_file_is_refused_and_not_waited_for(copy: Path) -> None:
    file = copy / "noisy" / "zarr.json"
    file.unlink()
    os.mkfifo(file)
    refused(lambda: Cube.open(copy), "regular file")


def frame(claim: int) -> bytes:
    """A Zstandard frame that says it holds ``claim`` bytes, with the checksum a chunk has."""
    content = untrusted.ZSTD_MAGIC + bytes([0b1110_0000]) + claim.to_bytes(8, "little") + b"\x01\x00\x00"
    return content + crc32c(content).to_bytes(4, "little")


@pytest.mark.parametrize("content", [frame(1 << 60), frame((1 << 29) + 1), untrusted.ZSTD_MAGIC + bytes(20)])
def test_a_chunk_that_claims_to_be_huge_is_refused_before_it_is_decoded(
    copy: Path, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Cube.open(copy).groups["noisy"]
    chunk = store.layout.chunks[0]
    store.chunk_file("cost", chunk).write_bytes(content)

    def never(*_: object) -> None:
        raise AssertionError("decoded")

    tree = open_results(copy)
    monkeypatch.setattr("zarr.codecs.zstd.Zstd.decode", never)
    refused(lambda: store.read("cost", chunk), "cost")
    refused(lambda: tree["noisy"]["cost"].isel(amplitude=chunk.amplitude).compute(), "cost")


def test_the_size_a_frame_claims_is_read_as_zstd_writes_it() -> None:
    for n in (0, 1, 200, 255, 256, 257, 65_535, 65_536, 65_791, 65_792, 1_000_000):
        assert untrusted.zstd_claim(zstd.compress(bytes(n), 3)) == n


def test_strings_that_claim_to_be_many_are_refused(copy: Path) -> None:
    (file,) = (copy / "noisy" / "parameter").glob("c*")
    content = bytearray(zstd.decompress(file.read_bytes()[:-4]))
    content[:4] = (2**31).to_bytes(4, "little")
    packed = bytes(zstd.compress(bytes(content), 3))
    file.write_bytes(packed + crc32c(packed).to_bytes(4, "little"))
    refused(lambda: open_results(copy), "parameter", "12 strings")


def test_a_file_larger_than_any_chunk_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 40)  # sparse
    refused(lambda: untrusted.real_bytes(tmp_path / "huge"), "expected at most")


class Evil:
    """An object whose unpickling makes a file."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return (Path.touch, (self.trace,))


def test_a_zarr_v2_store_with_pickled_objects_is_not_read(tmp_path: Path) -> None:
    out, trace = tmp_path / "out.zarr", tmp_path / "executed"
    array = {"zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "compressor": None, "fill_value": None}
    (out / "x").mkdir(parents=True)
    (out / ".zgroup").write_text('{"zarr_format": 2}')
    (out / "x" / ".zarray").write_text(json.dumps({**array, "order": "C", "filters": [{"id": "pickle"}]}))
    (out / "x" / ".zattrs").write_text('{"_ARRAY_DIMENSIONS": ["x"]}')
    (out / "x" / "0").write_bytes(pickle.dumps(Evil(trace)))
    refused(lambda: open_results(out), "expected a results cube")
    assert not trace.exists()
    pickle.loads((out / "x" / "0").read_bytes())  # the chunk does what it is here for
    assert trace.exists()


def test_nothing_of_the_package_unpickles_or_evaluates_what_it_did_not_bring_itself() -> None:
    """Compiled code that came in the wheel is unpickled after its SHA-256 is compared (`stance/test_shipped.py`)."""
    forbidden = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "joblib", "yaml"}
    found = []
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names: set[str] = set()
            if isinstance(node, ast.Import):
                names = {alias.name.split(".")[0] for alias in node.names} & forbidden
            elif isinstance(node, ast.ImportFrom):
                names = {str(node.module).split(".")[0]} & forbidden
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                names = {node.func.id} & {"eval", "exec", "compile", "__import__"}
            elif isinstance(node, ast.keyword) and not (isinstance(node.value, ast.Constant) and not node.value.value):
                names = {node.arg} & {"allow_pickle"} if node.arg else set()
            found += [f"{file.relative_to(PACKAGE).as_posix()}: {name}" for name in names]
    assert found == ["compiling/numba_internals.py: pickle"]
