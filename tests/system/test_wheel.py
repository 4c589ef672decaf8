"""The real wheel and the real source archive, on the oldest and the newest Python there is, without the repository.

The wheel of this Python is unpacked where nothing can be written and run with an empty home: nothing is compiled, same
bits. The source archive is installed by pip into an environment of the newest Python, which compiles the kernels then.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

STUDY = """
[study]
name = "wheel"
seed = 5

[group.spectral]
realizations = 2
starts = 10
fmax = [1.2]
amplitude = [5.0]

[group.linearised]
realizations = 1
starts = 2
fmax = [1.2]
amplitude = [5.0]
[group.linearised.fit]
starts = "linearised"

[group.in_time]
simulator = "time_domain"
realizations = 1
starts = 2
fmax = [1.2]
amplitude = [5.0]
"""

# `mcstudy ...` that says where it is from and how many functions were compiled.
COMMAND = """
import sys
from numba.core import event

class Count(event.Listener):
    compiled = 0
    def on_start(self, event):
        Count.compiled += 1
    def on_end(self, event):
        pass

event.register("numba:compile", Count())
import mcstudy
from mcstudy.cli import main
code = main(sys.argv[1:])
print(f"from {mcstudy.__file__}, {Count.compiled} compiled")
sys.exit(code)
"""


ASKED = "MCSTUDY_TEST_WHEEL"
"""Variable that asks for these tests: each builds a wheel, which compiles everything."""


pytestmark = [
    pytest.mark.skipif(ASKED not in os.environ, reason=f"built and tried where {ASKED}=1 asks for it (.ci/run)"),
    pytest.mark.skipif(
        sys.platform != "linux" or platform.machine() != "x86_64", reason="wheels hold compiled code for x86-64 Linux"
    ),
]


def newest_python() -> str | None:
    """The newest Python on this machine that is newer than this one."""
    found: dict[tuple[int, ...], str] = {}
    installed = (Path.home() / ".pyenv" / "versions").glob("3.*/bin/python")
    for program in [*map(str, installed), *(f"python3.{minor}" for minor in range(sys.version_info.minor + 1, 20))]:
        try:  # a name may be that of a program that only says it is not there
            call = [program, "-c", "import sys, venv, ensurepip; print(*sys.version_info[:3])"]
            said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
        except (OSError, subprocess.CalledProcessError):
            continue
        found[tuple(map(int, said.split()))] = program
    newest = max(found, default=(0, 0))
    return found[newest] if newest[:2] > sys.version_info[:2] else None


def test_the_source_archive_installs_with_compiled_kernels_on_the_newest_python(tmp_path: Path) -> None:
    python = newest_python()
    if python is None:
        pytest.skip("there is no newer Python on this machine")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, text=True)
    (archive,) = tmp_path.glob("mcstudy-*.tar.gz")
    subprocess.run([python, "-m", "venv", str(tmp_path / "venv")], check=True)
    programs, work = tmp_path / "venv" / "bin", tmp_path / "work"
    work.mkdir()
    variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}
    variables["HOME"] = str(work)

    def call(*words: str) -> str:
        done = subprocess.run(words, cwd=work, env=variables, capture_output=True, text=True, timeout=1200)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "compiling" not in done.stderr
        return done.stdout

    call(str(programs / "pip"), "install", "--quiet", "--constraint", str(ROOT / "constraints.txt"), str(archive))
    mcstudy = str(programs / "mcstudy")
    assert "2250 fits" in call(mcstudy, "run", "quick", "-o", "quick.zarr")
    assert "0 damaged" in call(mcstudy, "verify", "quick.zarr", "--cells", "5")
    assert "Study quick" in call(mcstudy, "show", "quick.zarr")
    assert call(mcstudy, "warm").startswith("0 functions compiled")
    assert "passive_damping_ankle" in call(mcstudy, "gap", "effects")


def test_a_first_run_from_the_wheel_compiles_nothing_and_has_the_same_bits(tmp_path: Path) -> None:
    from llvmlite import binding

    from mcstudy.stance.shipped import FOLDER

    if not {"avx2", "fma", "bmi2"} <= {name for name, on in binding.get_host_cpu_features().items() if on}:
        pytest.skip("this processor compiles for itself")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path / "dist")]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, text=True)
    (wheel,) = (tmp_path / "dist").iterdir()
    assert re.fullmatch(r"mcstudy-[\d.]+-cp3\d+-cp3\d+-.*x86_64\.whl", wheel.name)
    site, home, work = tmp_path / "site", tmp_path / "home", tmp_path / "work"
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(site)
    home.mkdir()
    work.mkdir()
    (work / "study.toml").write_text(STUDY)
    held = _files(site)
    assert any(FOLDER in name for name in held)
    folders = [site, *(folder for folder in site.rglob("*") if folder.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "XDG_"))}
    variables |= {"PYTHONDONTWRITEBYTECODE": "1"}

    def mcstudy(*words: str, **more: str) -> str:
        """The first path of these variables comes before the source that is installed to be edited."""
        call = [sys.executable, "-c", COMMAND, *words]
        done = subprocess.run(call, cwd=work, env=variables | more, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr
        if more:
            assert "compiling" not in done.stderr
        return done.stdout

    installed = {"PYTHONPATH": str(site), "HOME": str(home)}
    try:
        said = mcstudy("run", "study.toml", "-o", "wheel.zarr", **installed)
        assert f"from {site / 'mcstudy' / '__init__.py'}, 0 compiled" in said
        said = mcstudy("warm", **installed)
        assert said.startswith("0 functions compiled")
        assert ", 0 compiled" in said
        assert "goodworth2018" in mcstudy("studies", **installed)
        assert f"This page: {site / 'mcstudy' / 'pipelines' / 'examples'}" in mcstudy("help", "examples", **installed)
        assert "usage: mcstudy gap" in mcstudy("help", "gap", **installed)
    finally:
        for folder in folders:
            folder.chmod(0o755)
    assert _files(site) == held
    assert not [name for name in _files(home) if name.endswith((".nbi", ".nbc"))]

    said = mcstudy("run", "study.toml", "-o", "source.zarr")
    assert f"from {ROOT / 'mcstudy' / '__init__.py'}" in said
    chunks = _files(work / "source.zarr")
    assert chunks == _files(work / "wheel.zarr")
    assert len(chunks) > 20


def _files(folder: Path) -> dict[str, bytes]:
    return {f.relative_to(folder).as_posix(): f.read_bytes() for f in folder.rglob("*") if f.is_file()}
