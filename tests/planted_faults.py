"""Whether the tests find faults: ``python -m tests.planted_faults [WORD...]``.

Each fault of ``planted_faults.toml`` is planted alone in a copy of the package, and the tests that should find it run
there. A fault that they do not find has survived; all such are named, and the command ends with 1. Words choose the
faults that hold one of them. Where a module moved, the text is still found: it must stand exactly once in the whole
package.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".toml")
PARTS = ("mcstudy", "pipelines", "results_schema", "tests")
FILES = ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md")
SOURCES = ("mcstudy", "pipelines/mcstudy_*")
"""Where faults are planted."""

ONE_FAILED = 1
"""Exit code of pytest when a test failed; others are faults of this list, such as a file that is not there."""


class Fault(NamedTuple):
    """A fault of one line: ``right`` is replaced by ``wrong``, which ``tests`` (below ``tests/``) should find."""

    what: str
    right: str
    wrong: str
    tests: str


FAULTS = tuple(Fault(**fault) for fault in tomllib.loads(LIST.read_text(encoding="utf-8"))["fault"])


def sources(folder: Path) -> dict[Path, str]:
    """Every file in which a fault can be planted, and its text."""
    files = [file for part in SOURCES for top in sorted(folder.glob(part)) for file in sorted(top.rglob("*.py"))]
    return {file: file.read_text(encoding="utf-8") for file in files}


def place(texts: dict[Path, str], right: str) -> Path:
    """The file that holds a text, which stands once in all `sources`; `ValueError` otherwise."""
    found = [file for file, text in texts.items() for _ in range(text.count(right))]
    if len(found) != 1:
        raise ValueError(f"expected once, found {len(found)} times: {right!r}")
    return found[0]


def survives(folder: Path, fault: Fault) -> bool:
    """Whether the tests of a fault pass with it; the copy in ``folder`` is as before afterwards."""
    texts = sources(folder)
    file = place(texts, fault.right)
    text = texts[file]
    file.write_text(text.replace(fault.right, fault.wrong), encoding="utf-8")
    for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
        compiled.unlink()
    path = os.pathsep.join(str(p) for p in (folder, folder / "pipelines"))
    tests = [str(folder / "tests" / name) for name in fault.tests.split()]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        file.write_text(text, encoding="utf-8")
    if done.returncode not in (0, ONE_FAILED) or "error during collection" in done.stdout:
        raise RuntimeError(f"{fault.what}: {fault.tests} cannot run\n{done.stdout}{done.stderr}")
    print(done.stdout.splitlines()[-1], end=" ", flush=True)
    return done.returncode == 0


def main(words: list[str]) -> int:
    """Plant the faults one by one; the number of those that survive, at most 1."""
    chosen = [f for f in FAULTS if not words or any(word in " ".join(f) for word in words)]
    alive = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in PARTS:
            shutil.copytree(ROOT / part, folder / part)  # with compiled modules, which are as old as their sources
        for part in FILES:
            shutil.copy2(ROOT / part, folder / part)
        for number, fault in enumerate(chosen, 1):
            print(f"{number}/{len(chosen)} {fault.what} ({fault.tests}):", end=" ", flush=True)
            alive += [fault] if survives(folder, fault) else []
            print("SURVIVED" if fault in alive else "found", flush=True)
    print(f"{len(chosen) - len(alive)} of {len(chosen)} faults found")
    return min(len(alive), 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
