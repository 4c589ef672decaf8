"""Time of one diagnosis: a recording of two trials of six cycles, from a cold process (caches warm)."""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from pipelines.benchmarks.measure import mcstudy, run_command
from pipelines.benchmarks.report import Result, Sizes

METHODS = {"bootstrap": (), "fast": ("--fast",)}


def run(sizes: Sizes) -> Result:
    """`gap diagnose` with 1,000 refits of the null, and with ``--fast``; median of whole processes."""
    result = Result("diagnosis")
    with tempfile.TemporaryDirectory() as name:
        recording = Path(name) / "recording.nc"
        effect = "passive_damping_ankle=40"
        cycles = ("--cycles", "6")  # of two trials, the default
        run_command(*mcstudy("simulate", "-o", recording, *cycles, "--effect", effect, "--seed", "4"))
        run_command(*mcstudy("gap", "diagnose", recording, "--fast"))  # warms caches
        for method, options in METHODS.items():
            used = [run_command(*mcstudy("gap", "diagnose", recording, *options)) for _ in range(sizes.repeats)]
            wall = statistics.median(u.wall for u in used)
            cpu = statistics.median(u.cpu for u in used)
            result.keys[f"diagnosis.{method}_s"] = wall
            result.keys[f"diagnosis.{method}_cpu_s"] = cpu
            result.table.append({"method": method, "wall s": wall, "CPU s": cpu})
    result.notes.append("whole processes, start-up and imports included; a busy machine shows in wall seconds")
    return result
