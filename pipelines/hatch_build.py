"""Compiles the kernels when a wheel is built and puts them into it, so that a first run does not have to.

A wheel is for the machine that it is built on. On x86-64 Linux its code is for any processor with AVX2 and fused
multiply-add (x86-64-v3); that of the fits is there once more for AVX-512 (x86-64-v4), whose wider registers suit them.
The numbers are the same. On AArch64 Linux it is for any processor (ARMv8-A with its vector unit). Such a wheel has the
tag of the Python and the platform that built it, ``cp311-cp311-linux_x86_64`` for example; the code is linked against
no library, so that the version of the C library does not matter. A wheel that is built on another machine, or where
the kernels cannot be compiled, holds none, has the tag ``py3-none-any``, and compiles on first use. Nothing happens for
editable installations and source archives. HATCH_BUILD_NO_HOOKS=1 builds without.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

V3 = (
    *("cmov", "cx8", "fxsr", "mmx", "sse", "sse2"),
    *("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3", "crc32"),
    *("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
)

V4 = (*V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")

FITS = ("lm", "gram", "diagnosis")
"""Parts of `mcstudy.fitting.warm` that wide registers suit."""


class Target(NamedTuple):
    """A kind of processor.

    Attributes
    ----------
    name: of its folder in the wheel. cpu: as LLVM calls it. features: what the code may use.
    parts: of `mcstudy.fitting.warm` that are compiled for it; none: all.
    """

    name: str
    cpu: str
    features: tuple[str, ...]
    parts: tuple[str, ...] = ()


TARGETS = {
    "x86_64": (Target("x86-64-v3", "x86-64-v3", V3), Target("x86-64-v4", "x86-64-v4", V4, FITS)),
    "aarch64": (Target("armv8-a", "generic", ("fp-armv8", "neon")),),
}
"""Kinds of processors that a wheel built on a machine has code for, by the machine's name."""

NEEDED = ("llvmlite", "numba", "numpy", "pydantic", "scipy")
"""What the compiled modules and those around them import."""

COMPILE = """
import sys
from pathlib import Path

from mcstudy.fitting.warm import compile_here
from mcstudy.compiling.decorators import ship

compile_here(sys.argv[2:])
ship(Path(sys.argv[1]))
"""


class CompiledKernels(BuildHookInterface):  # type: ignore[type-arg]
    """The hook."""

    def dependencies(self) -> list[str]:
        """Versions to compile with: those of .ci/constraints.txt, since the code is used with no others."""
        if not targets() or _editable():
            return []
        text = (Path(self.root) / ".ci" / "constraints.txt").read_text(encoding="utf-8")
        return re.findall(rf"^(?:{'|'.join(NEEDED)})==.*$", text, re.MULTILINE)

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and add what came of it to the wheel."""
        if version == "editable":  # the wings are imported from where they are; a copy of them would go stale
            build_data["force_include_editable"] = {"LICENSE": "mcstudy-LICENSE"}
        if version != "standard" or not (wanted := targets()):
            return
        self._folder = tempfile.mkdtemp(prefix="mcstudy-compiled-")
        folder = Path(self._folder)
        code = folder / "code"
        with ThreadPoolExecutor() as pool:
            reasons = list(
                pool.map(lambda t: _compile(Path(self.root), t, code / t.name, folder / f"numba-{t.name}"), wanted)
            )
        for target, reason in zip(wanted, reasons, strict=True):
            if reason:  # compiling runs the code, which this machine's processor may not have the instructions for
                shutil.rmtree(code / target.name, ignore_errors=True)
                self.app.display_warning(f"the wheel is built without code for {target.name}: {reason}")
        if all(reasons):
            return
        build_data["force_include"][str(code)] = "mcstudy/_compiled"
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is in the wheel now."""
        del version, build_data, artifact_path
        if folder := getattr(self, "_folder", ""):
            shutil.rmtree(folder, ignore_errors=True)


def targets() -> tuple[Target, ...]:
    """Kinds of processors that a wheel built here has code for; none where it holds no code."""
    if sys.platform != "linux" or sys.implementation.name != "cpython":
        return ()
    return TARGETS.get(platform.machine(), ())


def _editable() -> bool:
    """Whether an editable installation asks: the interface does not tell, and it should not wait for numba."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        if frame.f_code.co_name == "get_requires_for_build_editable":
            return True
    return False


def _compile(root: Path, target: Target, code: Path, kept: Path) -> str:
    """Compile the kernels of the source at ``root`` into the folder ``code``; returns why it was not possible."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    variables = {
        "NUMBA_CACHE_DIR": str(kept),
        "NUMBA_CPU_NAME": target.cpu,
        "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in target.features),
        # Isolated builds hand their packages over in this variable too.
        "PYTHONPATH": os.pathsep.join(
            [str(kept), str(root), str(root / "pipelines"), *filter(None, [inherited.get("PYTHONPATH")])]
        ),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    # From an empty folder, so that nothing but the source at `root` is found as mcstudy.
    kept.mkdir()
    _install(root, kept)
    done = subprocess.run(
        [sys.executable, "-c", COMPILE, str(code), *target.parts],
        env=inherited | variables,
        cwd=kept,
        capture_output=True,
        text=True,
    )
    if done.returncode == 0:
        return ""
    return (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]


def _install(root: Path, folder: Path) -> None:
    """Write the entry points that solvers attach by, of which nothing is installed yet where a wheel is built."""
    groups = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    lines = [f"{name} = {place}" for name, place in groups["mcstudy.solvers"].items()]
    (folder / "mcstudy-0.dist-info").mkdir()
    text = "\n".join(["[mcstudy.solvers]", *lines, ""])
    (folder / "mcstudy-0.dist-info" / "entry_points.txt").write_text(text, encoding="utf-8")
