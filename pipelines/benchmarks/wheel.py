"""A first run from a wheel and from source, and the wheel's code compared with code compiled for this processor."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pipelines.benchmarks.measure import mcstudy, run_command
from pipelines.benchmarks.report import Result, Sizes
from pipelines.benchmarks.studies import LIBRARIES, PIPELINES

ROOT = PIPELINES.parent
QUICK = PIPELINES / "quick.toml"


def run(sizes: Sizes) -> Result:
    """First runs with an empty home (CPU and wall-clock seconds), and the ratio of the fits' times, in turn.

    The wheel is built unless ``sizes.wheel`` names one: it compiles every kernel, which takes minutes. Raises
    `RuntimeError` when a run from the wheel compiles anything, or when the two codes differ in a bit.
    """
    result = Result("wheel")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = sizes.wheel or _built(folder)
        site, home, native = folder / "site", folder / "home", folder / "native"
        for new in (site, home, native):
            new.mkdir()
        with zipfile.ZipFile(wheel) as packed:
            packed.extractall(site)
        codes = sorted(code.name for code in (site / "mcstudy" / "_compiled").glob("*"))
        wheels = {"PYTHONPATH": f"{site}{os.pathsep}{ROOT}", "HOME": str(home)}
        source = {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(native)}
        for k in range(sizes.repeats):
            used = run_command(*_run(folder / f"wheel_{k}.zarr"), **wheels)
            floor = run_command(sys.executable, "-c", LIBRARIES).cpu
            _row(result, "first run from the wheel", "first_run", used.cpu, used.wall, floor)
        used = run_command(*_run(folder / "source.zarr"), **source)
        _row(result, "first run from source", "source_first_run", used.cpu, used.wall, floor)
        used = run_command(*_run(folder / "later.zarr"), **source)
        _row(result, "later run from source", "source_later_run", used.cpu, used.wall, floor)
        ratios = _ratios(sizes, wheels, source, site)
        if list(site.rglob("*.nbi")) or list(home.rglob("*.nbi")):
            raise RuntimeError(f"{wheel}: a run from the wheel compiled for itself")
    low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75])
    result.keys |= {"wheel.shipped_over_native": middle, "wheel.quartile_1": low, "wheel.quartile_3": high}
    result.notes.append(
        f"code in the wheel: {', '.join(codes)}; time of its fits over that of code compiled for this processor: "
        f"{middle:.3f} (quartiles {low:.3f} and {high:.3f} of {len(ratios)} turns), with the same bits"
    )
    return result


def _built(folder: Path) -> Path:
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def _run(out: Path) -> tuple[str, ...]:
    """A run of the quick study by the package that comes first in PYTHONPATH, wherever this process stands."""
    python, *words = mcstudy("run", QUICK, "-o", out)
    return (python, "-P", *words)


def _row(result: Result, what: str, key: str, cpu: float, wall: float, floor: float) -> None:
    """The lowest of repeated measurements stays."""
    key = f"wheel.{key}_cpu_s"
    if cpu > result.keys.get(key, np.inf):
        return
    result.keys[key] = cpu
    row = {"what": what, "CPU s": cpu, "wall s": wall, "imports, CPU s": floor}
    result.table[:] = [r for r in result.table if r["what"] != what] + [row]


def _ratios(sizes: Sizes, wheels: dict[str, str], source: dict[str, str], site: Path) -> np.ndarray:
    """Time of the wheel's code over that of native code, turn by turn."""
    with _turns(sizes, wheels) as shipped, _turns(sizes, source) as native:
        said = [_line(process).split() for process in (shipped, native)]
        if not said[0][0].startswith(str(site)) or said[1][0].startswith(str(site)):
            raise RuntimeError(f"expected the packages of the wheel and of the source, got {said[0][0]}, {said[1][0]}")
        if said[0][1] != said[1][1]:
            raise RuntimeError("the wheel's code and native code differ in their costs")
        pairs = []
        for _ in range(8 * sizes.repeats + 1):
            pairs.append([_turn(process) for process in (shipped, native)])
    times = np.array(pairs)
    return times[:, 0] / times[:, 1]


@contextmanager
def _turns(sizes: Sizes, variables: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "benchmarks.kernel_turns", "64" if sizes.starts < 50 else "256"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **variables},
    )
    with process:  # closes its input at the end, which ends it
        yield process


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def _turn(process: subprocess.Popen[str]) -> float:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return float(_line(process))
