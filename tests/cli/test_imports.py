"""A look at results imports only what it needs: importing a library takes longer than the look itself."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mcstudy as mc
from mcstudy.analysis import cache

SCRIPT = """
import sys
from mcstudy.cli import main
code = main(sys.argv[1:])
print(*sys.modules, sep="\\n", file=sys.stderr)
sys.exit(code)
"""

LARGE = {"pandas", "xarray", "dask", "distributed", "zarr", "scipy.stats", "scipy.optimize", "matplotlib"}
COMPILED = {"numba", "scipy"}
UNUSED = {"pydantic", "numcodecs", "jsonschema", "scipy.ndimage"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sway") / "a.nc"
    return mc.write_recording(mc.simulate(amplitude=5.0, cycles=4, seed=4), path)


def imported(*words: str) -> set[str]:
    """Modules that a command has imported when it ends."""
    ran = subprocess.run([sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, env=os.environ)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return set(ran.stderr.split())


def test_status_reads_a_cube_without_any_library_of_arrays_but_numpy(two_chunks: Path) -> None:
    assert not imported("status", str(two_chunks)) & (LARGE | COMPILED)


def test_a_first_show_imports_no_library_of_statistics_and_a_second_none_of_numbers(two_chunks: Path) -> None:
    shutil.rmtree(cache.folder(two_chunks), ignore_errors=True)
    first = imported("show", str(two_chunks))
    assert "xarray" in first
    assert not first & {"distributed", "scipy.stats", "scipy.optimize", "matplotlib"}
    assert not imported("show", str(two_chunks)) & (LARGE | COMPILED | {"numpy", "pydantic"})


def test_a_second_report_needs_no_library_of_numbers_or_figures(two_chunks: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    words = ("report", str(two_chunks), "-o", str(tmp_path / "a.html"))
    assert "matplotlib" in imported(*words)
    first = (tmp_path / "a.html").read_bytes()
    assert not imported(*words) & (LARGE | COMPILED | {"numpy", "pydantic"})
    assert (tmp_path / "a.html").read_bytes() == first


def test_a_fast_diagnosis_of_a_netcdf_file_needs_no_library_of_tables_or_of_checks(recording: Path) -> None:
    assert not imported("gap", "diagnose", str(recording), "--fast") & (LARGE | UNUSED)


def test_a_command_that_ends_is_not_searched_for_garbage() -> None:
    script = "import gc, sys; from mcstudy.cli import main; main(); print(gc.get_freeze_count(), file=sys.stderr)"
    as_command = subprocess.run([sys.executable, "-c", script, "studies"], capture_output=True, text=True)
    called = script.replace("main()", "main(['studies'])")
    as_function = subprocess.run([sys.executable, "-c", called], capture_output=True, text=True)
    assert int(as_command.stderr) > 10_000
    assert int(as_function.stderr) == 0, "somebody else's process is left as it is"
