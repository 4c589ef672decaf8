"""What is refused changes nothing: every verb that writes, with arguments that it refuses."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.files.local_path import local_path
from mcstudy.scheduler import cluster
from mcstudy.study.verify import verify

LONG = "n" * 300
SOLVE = "solve s.toml --target cv(Td1)<=10% --over cycles,amplitude -o"
NOBODY = "--scheduler tcp://127.0.0.1:9"
"""The discard port, on which nothing listens."""

REFUSED = (
    *(
        f"run s.toml -o {out}"
        for out in ("c.zarr/noisy", "c.zarr/noisy/estimate", "c.zarr/new", "c.zarr/new/deep.zarr")
    ),
    *(f"run s.toml -o {out}" for out in ("group", "foreign", "empty", "file.txt", "file.txt/x.zarr", "loop", "loop/x")),
    *(f"run s.toml -o {out}" for out in (LONG, "s3://bucket/q.zarr", "gs://bucket/q.zarr", "https://host/q.zarr")),
    "run s.toml -o file://host/q.zarr",
    "run s.toml --out=s3://bucket/q.zarr",
    "run s3://bucket/s.toml -o n.zarr",
    "run other.toml -o c.zarr",
    "run bad.toml -o n.zarr",
    "run s.toml -o foreign --quarantine",
    f"run s.toml -o n.zarr {NOBODY}",
    f"run more.toml -o deep/down/n.zarr {NOBODY}",
    "run s.toml -o n.zarr --scheduler tcp://127.0.0.1:99999",
    "run s.toml -o n.zarr --scheduler=http://127.0.0.1:8786",
    "run s.toml -o n.zarr --slurm file.txt",
    "run s.toml -o n.zarr --until-mcse bias=1%",
    "run s.toml -o n.zarr --until-mcse bias=1% --budget-fits 3",
    "run s.toml -o foreign --until-mcse bias=1% --budget-fits 30000",
    *(
        f"extend {out} --starts 9"
        for out in ("c.zarr/noisy", "group", "foreign", "empty", "none.zarr", "file.txt", "loop")
    ),
    "extend s3://bucket/c.zarr --starts 9",
    "extend c.zarr --realizations 1",
    "extend c.zarr --starts 1",
    "extend c.zarr --fmax nan",
    "extend c.zarr --fmax 100",
    "extend c.zarr --amplitude -3",
    "extend c.zarr --group nothing --starts 9",
    f"extend c.zarr --starts 9 {NOBODY}",
    *(
        f"{verb} {out}"
        for verb in ("show", "verify", "status")
        for out in ("foreign", "none.zarr", "c.zarr/noisy", "loop")
    ),
    *(f"{verb} {out}" for verb in ("show", "verify", "status") for out in ("file.txt", "c.zip", "s3://bucket/c.zarr")),
    "show c.zarr --compare c.zip",
    "replay c.zarr --realization 99 --start 0 --amplitude 5 --fmax 1.2",
    "report none.zarr -o p.html",
    *(f"report c.zarr -o {out}" for out in ("foreign", "file.txt/p.html", "s3://bucket/p.html")),
    *(
        f"simulate -o {out}"
        for out in ("foreign", "c.zarr", "foreign/x.txt", "file.txt/x.nc", "loop/x.nc", f"{LONG}.nc")
    ),
    "simulate -o gs://bucket/x.nc",
    "simulate -o n.nc --effect nothing=1",
    "import rec.csv -o n.nc",
    "import none.csv -o n.nc --unit deg",
    "import s3://bucket/rec.csv -o n.nc",
    "fit none.nc -o n",
    "fit https://host/rec.nc -o n",
    "study-from none.nc -o n.toml",
    "design s.toml -o n",
    "design design -o foreign --no-verify",
    "design design -o file.txt --no-verify",
    "design design -o c.zarr --no-verify",
    "design design -o c.zarr/noisy/n --no-verify",
    *(f"{SOLVE} {out}" for out in ("foreign", "file.txt/n.toml", "s3://bucket/n.toml")),
    "infer nothing -o n",
    "infer table_one -o foreign",
    "infer table_one -o c.zarr",
    "performance perf.csv -o n.csv",
    "gap diagnose none.nc -o n",
    "gap report none.nc -o n.html",
    "gap next none.nc --html n.html",
    "gap challenge make none.toml --data n --key k.json",
    "gap challenge make gap_challenge --data foreign --key k.json",
    "gap challenge run gap_challenge -o foreign",
    "gap challenge answer foreign -o n.json",
)

State = dict[str, tuple[int, bytes | str | None]]


def state(folder: Path) -> State:
    """Names, bytes and times of everything below a folder.

    The time of a folder is left out: a page is begun before it is drawn, and taken away again.
    """
    found: State = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            held: bytes | str | None = str(path.readlink())
        else:
            held = path.read_bytes() if path.is_file() else None
        found[str(path.relative_to(folder))] = (0 if held is None else path.lstat().st_mtime_ns, held)
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("refused")
    study = mc.Study("s", seed=1).group("noisy", realizations=2, starts=2, fmax=[0.41, 1.2], amplitude=[3, 5])
    (folder / "s.toml").write_text(study.to_toml())
    (folder / "other.toml").write_text(study.to_toml().replace("seed = 1", "seed = 2"))
    (folder / "more.toml").write_text(study.to_toml().replace("realizations = 2", "realizations = 3"))
    (folder / "bad.toml").write_text("[study]\nname = 3\n")
    mc.run(study, folder / "c.zarr", workers=1)
    shutil.copytree(folder / "c.zarr" / "noisy", folder / "group")
    shutil.make_archive(str(folder / "c"), "zip", folder / "c.zarr")
    (folder / "empty").mkdir()
    (folder / "foreign").mkdir()
    for name in ("mine.txt", "waveform.csv", "trial1.csv", "recording.csv"):
        (folder / "foreign" / name).write_text("mine")
    (folder / "file.txt").write_text("text")
    (folder / "rec.csv").write_text("time,stimulus,theta1,theta2\n0,1,2,3\n")
    (folder / "perf.csv").write_text("parameter,realization,estimate\nK,1,2\n")
    (folder / "loop").symlink_to("loop2")
    (folder / "loop2").symlink_to("loop")
    return folder


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    monkeypatch.chdir(made)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return made


@pytest.mark.parametrize("words", REFUSED, ids=lambda words: words.replace(LONG, "LONG"))
def test_what_is_refused_changes_nothing(here: Path, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = state(here)
    assert main(words.split()) == Exit.BAD_INPUT
    said = capsys.readouterr()
    assert said.err.startswith("mcstudy: ")
    assert said.err.count("\n") == 1
    assert state(here) == before


def test_a_cube_is_sound_after_a_run_into_one_of_its_groups(here: Path) -> None:
    assert main(["run", "s.toml", "-o", "c.zarr/noisy"]) == Exit.BAD_INPUT
    assert verify(here / "c.zarr", cells=0).damage == []


def test_a_zip_of_a_cube_says_how_to_unpack_it(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "c.zip"]) == Exit.BAD_INPUT
    assert (
        "c.zip: expected the folder of a results cube, found a file; unpack it first: unzip" in capsys.readouterr().err
    )
    with pytest.raises(InputError, match="unpack it first"):
        mc.open_results(here / "c.zip")


@pytest.mark.parametrize(
    "address", ["s3://bucket/q.zarr", "gs://b/q.zarr", "https://h/q.zarr", "memory://q", "simplecache::s3://q"]
)
def test_an_address_is_no_path_in_python_either(here: Path, address: str) -> None:
    before = state(here)
    for ask in (
        lambda: mc.run("s.toml", address),
        lambda: mc.run("s.toml", Path("s3://bucket/q.zarr")),
        lambda: mc.open_results(address),
        lambda: mc.summary(address),
        lambda: mc.read_recording(address),
        lambda: mc.fit(address),
    ):
        with pytest.raises(InputError, match="expected a path of this machine"):
            ask()
    assert state(here) == before


def test_what_is_no_path_at_all_says_so(here: Path) -> None:
    from zarr.storage import LocalStore, MemoryStore

    with pytest.raises(InputError, match="expected a path of this machine, as its attribute root is, got LocalStore"):
        mc.open_results(LocalStore(here / "c.zarr"))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got MemoryStore"):
        mc.open_results(MemoryStore())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "path"),
    [
        ("C:/data/q.zarr", "C:/data/q.zarr"),
        ("a:b/q.zarr", "a:b/q.zarr"),
        ("s3:bucket", "s3:bucket"),
        ("12:30/q.zarr", "12:30/q.zarr"),
        ("file:///tmp/a%20b.zarr", "/tmp/a b.zarr"),
        ("file://localhost/tmp/q.zarr", "/tmp/q.zarr"),
        ("~/q.zarr", "~/q.zarr"),
    ],
)
def test_odd_names_are_paths(given: str, path: str) -> None:
    assert local_path(given) == Path(path)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (" s3://bucket/q", "s3:// is not supported"),
        (b"s3://bucket/q", "s3:// is not supported"),
        (Path("s3a://bucket/q"), "s3a:// is not supported"),
        (Path(" gs://bucket/q"), "gs:// is not supported"),
        (Path("file:///tmp/q"), "file:// as text only"),
        ("file:///tmp/%00", "without null characters"),
        ("a\0b", "without null characters"),
    ],
)
def test_what_no_file_can_be_called_is_refused(here: Path, given: str | bytes | Path, expected: str) -> None:
    before = state(here)
    with pytest.raises(InputError, match=expected):
        mc.run("s.toml", given)  # type: ignore[arg-type]
    assert state(here) == before


def test_a_run_into_a_folder_with_a_colon_and_one_named_by_a_file_address(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    study = str(made / "s.toml")
    assert main(["run", study, "-o", "C:/q.zarr", "--workers", "1"]) == Exit.DONE
    assert main(["run", study, "-o", f"file://{tmp_path}/f.zarr", "--workers", "1"]) == Exit.DONE
    assert {"C:", "f.zarr"} < set(os.listdir(tmp_path))
