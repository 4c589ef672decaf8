"""Compiles the kernels when a wheel is built and puts them into it, so that a first run does not have to.

The code is for any x86-64 processor with AVX2 and fused multiply-add (x86-64-v3), on Linux; that of the fits is there
once more for AVX-512 (x86-64-v4), whose wider registers suit them. The numbers are the same. A wheel for
other machines has none, and neither has one that is built where the kernels cannot be compiled; both compile on first
use. Nothing happens for editable installations and source archives. HATCH_BUILD_NO_HOOKS=1 builds without.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

V3 = (
    *("cmov", "cx8", "fxsr", "mmx", "sse", "sse2"),
    *("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3", "crc32"),
    *("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
)

V4 = (*V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")

TARGETS = {"x86-64-v3": (V3, ()), "x86-64-v4": (V4, ("lm", "gram", "diagnosis"))}
"""What the code may use, and which parts of `mcstudy.fitting.warm` it is made of (none: all), by processor."""

NEEDED = ("llvmlite", "numba", "numpy", "scipy")
"""What the compiled modules and those around them import."""

COMPILE = """
import sys
from pathlib import Path

from mcstudy.fitting.warm import compile_here
from mcstudy.stance.compiled import ship

compile_here(sys.argv[2:])
ship(Path(sys.argv[1]))
"""


class CompiledKernels(BuildHookInterface):  # type: ignore[type-arg]
    """The hook."""

    def dependencies(self) -> list[str]:
        """Versions to compile with: those of constraints.txt, since the code is used with no others."""
        if not _possible() or _editable():
            return []
        text = (Path(self.root) / "constraints.txt").read_text(encoding="utf-8")
        return re.findall(rf"^(?:{'|'.join(NEEDED)})==.*$", text, re.MULTILINE)

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and add what came of it to the wheel."""
        if version != "standard" or not _possible():
            return
        self._folder = tempfile.mkdtemp(prefix="mcstudy-compiled-")
        folder = Path(self._folder)
        code = folder / "code"
        with ThreadPoolExecutor() as pool:
            reasons = pool.map(lambda cpu: _compile(Path(self.root), cpu, code / cpu, folder / f"numba-{cpu}"), TARGETS)
        if reason := next(filter(None, reasons), ""):
            self.app.display_warning(f"the wheel is built without compiled kernels: {reason}")
            return
        build_data["force_include"][str(code)] = "mcstudy/_compiled"
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is in the wheel now."""
        del version, build_data, artifact_path
        if folder := getattr(self, "_folder", ""):
            shutil.rmtree(folder, ignore_errors=True)


def _possible() -> bool:
    return sys.platform == "linux" and platform.machine() == "x86_64" and sys.implementation.name == "cpython"


def _editable() -> bool:
    """Whether an editable installation asks: the interface does not tell, and it should not wait for numba."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if frame.f_code.co_name == "get_requires_for_build_editable":
            return True
    return False


def _compile(root: Path, cpu: str, code: Path, kept: Path) -> str:
    """Compile the kernels of the source at ``root`` into the folder ``code``; returns why it was not possible."""
    features, parts = TARGETS[cpu]
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    variables = {
        "NUMBA_CACHE_DIR": str(kept),
        "NUMBA_CPU_NAME": cpu,
        "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in features),
        # Isolated builds hand their packages over in this variable too.
        "PYTHONPATH": os.pathsep.join([str(root), *filter(None, [inherited.get("PYTHONPATH")])]),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    # From an empty folder, so that nothing but the source at `root` is found as mcstudy.
    kept.mkdir()
    done = subprocess.run(
        [sys.executable, "-c", COMPILE, str(code), *parts],
        env=inherited | variables,
        cwd=kept,
        capture_output=True,
        text=True,
    )
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
