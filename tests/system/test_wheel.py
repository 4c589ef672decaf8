"""The real source archive, as a newcomer gets it, without the repository.

pip builds a wheel from it, which compiles the kernels, and installs that into an environment of its own. Then nothing
more is compiled, where nothing can be written and with an empty home, and the results have the bits of a run from
source. (`test_bounds` installs with the newest Python there is.)
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
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

# One command after the other, in one process that says where it is from and how many functions it compiled.
COMMANDS = """
import json, sys
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
for words in json.loads(sys.argv[1]):
    if code := main(words):
        sys.exit(code)
print(f"from {mcstudy.__file__}, {Count.compiled} compiled")
"""


ASKED = "MCSTUDY_TEST_WHEEL"
"""Variable that asks for these tests: each builds a wheel, which compiles everything."""


pytestmark = [
    pytest.mark.skipif(ASKED not in os.environ, reason=f"built and tried where {ASKED}=1 asks for it (.ci/run)"),
    pytest.mark.skipif(
        sys.platform != "linux" or platform.machine() != "x86_64", reason="wheels hold compiled code for x86-64 Linux"
    ),
]


def test_what_pip_installs_holds_kernels_that_need_no_compiling_and_give_the_same_bits(tmp_path: Path) -> None:
    from llvmlite import binding

    from mcstudy.compiling.shipped import FOLDER

    if not {"avx2", "fma", "bmi2"} <= {name for name, on in binding.get_host_cpu_features().items() if on}:
        pytest.skip("this processor compiles for itself")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, text=True)
    (archive,) = tmp_path.glob("mcstudy-*")
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "venv")], check=True)
    programs, work, home = tmp_path / "venv" / "bin", tmp_path / "work", tmp_path / "home"
    work.mkdir()
    home.mkdir()
    (work / "study.toml").write_text(STUDY)
    variables = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "XDG_", "PYTHON"))}
    variables |= {"HOME": str(home), "PYTHONPYCACHEPREFIX": str(tmp_path / "bytecode")}
    variables["PIP_COMPILE"] = "0"  # modules that are never loaded need no bytecode

    def installed(*words: str) -> str:
        done = subprocess.run(words, cwd=work, env=variables, capture_output=True, text=True, timeout=1200)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "compiling" not in done.stderr
        return done.stdout

    pip = (str(programs / "pip"), "install", "--quiet", "--constraint", str(ROOT / ".ci" / "constraints.txt"))
    installed(*pip, str(archive))
    (site,) = (tmp_path / "venv" / "lib").glob("python3.*/site-packages/mcstudy")
    held = _files(site)
    assert any(FOLDER.name in name for name in held)
    (wheel,) = site.parent.glob("mcstudy-*.dist-info/WHEEL")
    assert re.search(r"^Tag: cp3\d+-cp3\d+-.*x86_64$", wheel.read_text(), re.MULTILINE)
    folders = [site, *(folder for folder in site.rglob("*") if folder.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    try:
        assert "2250 fits" in installed(str(programs / "mcstudy"), "run", "quick", "-o", "quick.zarr")
        commands = [
            ["run", "study.toml", "-o", "wheel.zarr"],
            ["verify", "quick.zarr", "--cells", "5"],
            ["show", "quick.zarr"],
            ["warm"],
            ["gap", "effects"],
            ["studies"],
            ["help", "examples"],
            ["help", "solve"],
            ["help", "design"],
        ]
        said = installed(str(programs / "python"), "-c", COMMANDS, json.dumps(commands))
        assert "usage: mcstudy gap" in installed(str(programs / "mcstudy"), "help", "gap")
    finally:
        for folder in folders:
            folder.chmod(0o755)
    for line in (
        "0 damaged",
        "quick: 2,250 fits",
        "0 functions compiled",
        "passive_damping_ankle",
        "goodworth2018",
        f"This page: {site / 'pipelines' / 'examples'}",
        f"from {site / '__init__.py'}, 0 compiled",
    ):
        assert line in said
    assert _files(site) == held
    assert not [name for name in _files(home) if name.endswith((".nbi", ".nbc"))]

    call = [sys.executable, "-c", COMMANDS, json.dumps([["run", "study.toml", "-o", "source.zarr"]])]
    variables = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(call, cwd=work, env=variables, capture_output=True, text=True, timeout=1200)
    assert done.returncode == 0, done.stderr
    assert f"from {ROOT / 'mcstudy' / '__init__.py'}" in done.stdout
    assert not (ROOT / "mcstudy" / FOLDER).exists()
    chunks = _files(work / "source.zarr")
    assert chunks == _files(work / "wheel.zarr")
    assert len(chunks) > 20


def _files(folder: Path) -> dict[str, bytes]:
    return {f.relative_to(folder).as_posix(): f.read_bytes() for f in folder.rglob("*") if f.is_file()}
