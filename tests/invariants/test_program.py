"""A process knows the source it runs: that of its start, and none once a file has changed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from mcstudy import program

ROOT = Path(__file__).parents[2]

ASK = """
import json, sys
from mcstudy import program
print(json.dumps([program.source(), program.source(("stance", "files")), program.maker()["source"]]), flush=True)
sys.stdin.readline()
print(json.dumps([program.source(), program.source(("stance", "files")), program.maker()["source"]]), flush=True)
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package and its schemas, to be edited."""
    for name in ("mcstudy", "results_schema"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def asked(copy: Path, change: Callable[[], object]) -> list[list[str | None]]:
    """What a process says of its source at its start and after a change of its files, and what the next one says."""
    call = [sys.executable, "-P", "-B", "-c", ASK]
    variables = {**os.environ, "PYTHONPATH": str(copy)}
    said: list[list[str | None]] = []
    for changes in (change, lambda: None):
        with subprocess.Popen(
            call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables, cwd=copy
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            said.append(json.loads(process.stdout.readline()))
            changes()
            process.stdin.write("\n")
            process.stdin.flush()
            said.append(json.loads(process.stdout.readline()))
    return said


def _edited(file: Path) -> None:
    file.write_bytes(file.read_bytes() + b" ")


def _edited_and_set_back(file: Path) -> None:
    about, content = file.stat(), file.read_bytes()
    file.write_bytes(content[:-1] + b" ")
    os.utime(file, ns=(about.st_atime_ns, about.st_mtime_ns))


def _replaced_by_an_older_file(file: Path) -> None:
    other = file.with_name("other")
    other.write_bytes(file.read_bytes() + b" ")
    os.utime(other, (0, 0))
    other.replace(file)


CHANGES: dict[str, Callable[[Path], object]] = {
    "a module": lambda at: _edited(at / "mcstudy/gap/verdict.py"),
    "a module, its time set back": lambda at: _edited_and_set_back(at / "mcstudy/gap/verdict.py"),
    "an older module": lambda at: _replaced_by_an_older_file(at / "mcstudy/gap/verdict.py"),
    "a module more": lambda at: (at / "mcstudy/gap/new.py").write_bytes(b""),
    "a module less": lambda at: (at / "mcstudy/gap/verdict.py").unlink(),
    "the style of the pages": lambda at: _edited(at / "mcstudy/report/page.css"),
    "a schema": lambda at: _edited(at / "results_schema/1.0.0/show.json"),
    "another folder in its place": lambda at: (
        shutil.copytree(at / "mcstudy", at / "new"),
        (at / "mcstudy").rename(at / "old"),
        _edited(at / "new/gap/verdict.py"),
        (at / "new").rename(at / "mcstudy"),
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_process_whose_files_changed_has_no_source_and_the_next_one_has_another(copy: Path, change: str) -> None:
    first, after, then, again = asked(copy, lambda: CHANGES[change](copy))
    assert None not in first
    assert after[:2] == [None, None]
    assert after[2] not in (first[2], then[2])  # what it makes belongs to neither
    assert then == again
    assert then[0] not in (None, first[0])


def test_what_python_and_editors_leave_is_no_change(copy: Path) -> None:
    def leave() -> None:
        (copy / "mcstudy" / "__pycache__").mkdir(exist_ok=True)
        (copy / "mcstudy" / "__pycache__" / "errors.cpython-311.pyc").write_bytes(b"x")
        (copy / "mcstudy" / ".errors.py.swp").write_bytes(b"x")
        (copy / "mcstudy" / ".#errors.py").symlink_to("someone@somewhere")

    first, after, then, again = asked(copy, leave)
    assert first == after == then == again


def test_the_source_is_that_of_the_files() -> None:
    assert program.unchanged()
    assert {"errors.py", "report/page.css", "results_schema/1.0.0/show.json", "analysis/cache.py"} < set(
        program.STARTED
    )
    everything, computing = program.source(), program.source(program.computing())
    assert everything != computing
    assert not {"api", "cli", "report", "results_schema"} & set(program.computing())


def test_a_library_is_called_by_the_version_that_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np

    monkeypatch.setattr(program, "_installed", lambda package: f"newer {package}")  # pip ran meanwhile
    assert program.versions(["numpy", "no such package"]) == {
        "numpy": np.__version__,
        "no such package": "newer no such package",
    }


def test_another_maker_is_described_in_words() -> None:
    own = program.maker()
    assert program.other_maker(own, own) == ""
    assert program.other_maker(None, own) == "it does not say by which program it was made"
    other = {"source": "1" * 64, "versions": {**own["versions"], "numpy": "0.1"}}
    assert program.other_maker(other, own) == (
        f"made by another program: source {'1' * 12}, here {own['source'][:12]}; "
        f"numpy 0.1, here {own['versions']['numpy']}"
    )
