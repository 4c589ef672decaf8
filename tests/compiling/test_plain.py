"""With a numba whose private parts are not as they were, kernels are compiled by its documented functions."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from mcstudy.compiling import numba_internals
from mcstudy.compiling.numba_internals import KNOWN, PLAIN, USED, fault

FITS = """
import hashlib
import numpy as np
from fit_problems import example
from mcstudy.compiling import decorators
from mcstudy.fitting.solvers import Options, fit
from mcstudy.fitting.starts import uniform
from mcstudy.stance.stability import growth_rate

problem = example("ml")
fits = fit(problem, uniform(problem.model, np.random.default_rng(3), 20), "lm", Options(1e-12, 300))
numbers = fits.estimate, fits.cost, fits.iterations, growth_rate(problem.model, fits.estimate)
bits = b"".join(np.ascontiguousarray(x).tobytes() for x in numbers)
print(decorators.INTERNALS is None, hashlib.sha256(bits).hexdigest())
"""
HIDE = "from numba.core import {module}\ndelattr({module}.{owner}, {name!r})"
WAYS = {
    "an attribute that is gone": HIDE.format(module="caching", owner="Cache", name="_load_overload"),
    "a class that is gone": "from numba.core import codegen\ndel codegen.JITCodeLibrary",
    "an unknown version": "import numba\nnumba.__version__ = '0.999.0'",
}


def test_the_private_parts_of_this_numba_are_as_they_are_used() -> None:
    assert fault() == ""


def test_a_version_outside_those_known_and_other_arguments_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for version in ("0.62.9", f"0.{KNOWN[1][1] + 1}.0", "1.0.0rc1"):
        with monkeypatch.context() as changed:
            changed.setattr(numba, "__version__", version)
            assert fault() == f"numba {version} is not one of those known (0.63 to 0.{KNOWN[1][1]})"
    for owner, name, arguments in USED:
        if isinstance(owner, type) and name in vars(owner) and arguments:
            with monkeypatch.context() as changed:
                changed.setattr(owner, name, lambda another: another)
                assert fault().startswith(f"{owner.__name__}.{name} of numba"), name
    monkeypatch.setenv(PLAIN, "1")
    assert fault() == f"{PLAIN} is set"


@pytest.mark.parametrize("way", WAYS)
def test_hidden_parts_leave_a_package_that_works_and_one_line_that_says_so(way: str) -> None:
    code = (
        "from mcstudy.compiling import decorators\nprint(decorators.INTERNALS, decorators.compiled(lambda x: 2 * x)(3))"
    )
    done = subprocess.run([sys.executable, "-c", f"{WAYS[way]}\n{code}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["None", "6"]
    (line,) = done.stderr.splitlines()
    assert line.startswith("mcstudy: ")
    assert "numba" in line
    assert line.endswith("kernels are compiled by numba's documented functions, which takes about a minute longer")


def test_plain_kernels_for_another_processor_give_the_same_bits(tmp_path: Path) -> None:
    """The kernel, a solver that calls it, and the certificate of stability; all are compiled here, once."""
    helpers = str(Path(__file__).parents[1] / "helpers")

    def run(**variables: str) -> tuple[str, str]:
        environment = {**os.environ, "PYTHONPATH": helpers, **variables}
        done = subprocess.run([sys.executable, "-c", FITS], capture_output=True, text=True, check=True, env=environment)
        mode, digest = done.stdout.split()
        return mode, digest

    generic = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    plain = run(**{PLAIN: "1", "NUMBA_CACHE_DIR": str(tmp_path)}, **generic)
    usual = run()
    assert (plain[0], usual[0]) == ("True", "False")
    assert plain[1] == usual[1]
    assert {"kernel.evaluate", "stability_kernel.rightmost"} <= {f.name.split("-")[0] for f in tmp_path.rglob("*.nbi")}


TWICE = """
from mcstudy.compiling.decorators import compiled

@compiled
def twice(x):
    return 2 * x
"""
CALLED = "from torn import twice; print(twice(3), sum(twice.stats.cache_hits.values()))"


def test_a_torn_file_of_compiled_code_is_compiled_again(tmp_path: Path) -> None:
    (tmp_path / "torn.py").write_text(TWICE)
    variables = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"PYTHONPATH": str(tmp_path)}

    def run() -> str:
        command = [sys.executable, "-c", CALLED]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=variables).stdout.strip()

    assert run() == "6 0"
    for ending, part in (("nbi", 0.0), ("nbi", 0.5), ("nbc", 0.0), ("nbc", 0.5)):
        (file,) = (tmp_path / "__pycache__").glob(f"torn.twice*.{ending}")
        content = file.read_bytes()
        file.write_bytes(content[: int(part * len(content))])
        assert run() == "6 0", (ending, part)
    assert run() == "6 1"


def test_all_private_parts_stand_in_one_module() -> None:
    package = Path(numba_internals.__file__).parents[1]
    private = re.compile(
        r"numba\.core(?! import (event|cgutils)$)|numba\._(?!_)|from numba import _|_nrt\b", re.MULTILINE
    )
    assert {f.name for f in package.rglob("*.py") if private.search(f.read_text())} == {"numba_internals.py"}
