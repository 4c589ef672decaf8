"""The lowest versions that pyproject.toml declares work, and so do the newest of everything without constraints.

Each is installed into an environment of its own, in which every step of a newcomer's first day is tried, and the quick
tests of every part that reads, computes or writes with a library. The lowest versions are read from pyproject.toml, so
that what is declared is what is tried.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from pythons import newest_python

ROOT = Path(__file__).parents[2]

ASKED = "MCSTUDY_TEST_BOUNDS"
"""Variable that asks for these tests: each installs everything and compiles everything."""

pytestmark = pytest.mark.skipif(ASKED not in os.environ, reason=f"tried where {ASKED}=1 asks for it (.ci/run)")

EXTRAS = ("report", "completion", "slurm")

TOOLS = ("pytest", "pytest-xdist", "hypothesis", "mpmath")
"""What the tests below need besides."""

DAY = (
    "run quick -o quick.zarr",
    "verify quick.zarr --cells 5",
    "show quick.zarr",
    "report quick.zarr -o quick.html",
    "simulate -o person.nc --seed 1",
    "fit person.nc --fmax 3",
    "gap diagnose person.nc --fast",
    "gap report person.nc --fast -o gap.html",
)

TESTS = (
    "analysis/test_accuracy.py",
    "files",
    "fitting/test_problem.py",
    "recordings/test_import.py",
    "recordings/test_recording.py",
    "spectra/test_lines.py",
    "stance/test_response.py",
    "study/test_store.py",
    "study/test_verify.py",
)


def lowest() -> list[str]:
    """The lowest version of every library that pyproject.toml declares, as constraints."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = [library for extra in EXTRAS for library in project["optional-dependencies"][extra]]
    declared = [*project["dependencies"], *optional]
    pinned = [re.fullmatch(r"([A-Za-z0-9_-]+)>=([0-9.]+)", library) for library in declared]
    assert None not in pinned, f"expected NAME>=VERSION: {declared}"
    return sorted({f"{library[1]}=={library[2]}" for library in pinned if library is not None})


@pytest.mark.parametrize("versions", ["lowest", "newest"])
def test_what_is_declared_works(versions: str, tmp_path: Path) -> None:
    constraints, programs = tmp_path / "constraints.txt", tmp_path / "venv" / "bin"
    constraints.write_text("\n".join(lowest() if versions == "lowest" else []))
    python = sys.executable if versions == "lowest" else newest_python()
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "PYTHON", "PYTEST_"))}
    variables |= {"NUMBA_CACHE_DIR": str(tmp_path / "compiled"), "MPLBACKEND": "agg"}

    def done(*words: str, where: Path = tmp_path) -> str:
        call = subprocess.run(words, cwd=where, env=variables, capture_output=True, text=True, timeout=3600)
        assert call.returncode == 0, f"{' '.join(words)}\n{call.stdout[-5000:]}\n{call.stderr[-5000:]}"
        return call.stdout

    done(python, "-m", "venv", str(tmp_path / "venv"))
    pip = (str(programs / "pip"), "install", "--quiet", "--no-compile", "--constraint", str(constraints))
    done(*pip, "--editable", f"{ROOT}[{','.join(EXTRAS)}]", *TOOLS)
    print(versions, done(str(programs / "pip"), "freeze", "--exclude-editable").replace("\n", " "))
    for command in DAY:
        said = done(str(programs / "mcstudy"), *command.split())
        assert "0 damaged" in said or not command.startswith("verify")
    testing = (str(programs / "python"), "-m", "pytest", "-q", "-x", "-W", "default", "-p", "no:cacheprovider")
    done(*testing, "--quick", *(str(Path("tests") / name) for name in TESTS), where=ROOT)
