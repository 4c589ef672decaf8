"""Studies of 10^5 to 10^8 fits that return at once, through the real scheduler and store.

`benchmarks.instant` runs ``mcstudy`` with fits that are drawn instead of computed, so what is measured is scheduling,
storing and looking at the results. Every verb is a process of its own.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.analysis import cache
from mcstudy.study.design import Study
from mcstudy.study.extent import extent
from mcstudy.study.study_file import parse_study
from pipelines.benchmarks.cases import study_text
from pipelines.benchmarks.measure import instant, mcstudy, run_command
from pipelines.benchmarks.report import Result, Sizes

FMAX, STARTS, AMPLITUDES = (0.41, 1.2, 8.0), 50, "3.0, 5.0"
"""Axes of the paper's accuracy group; realizations make the size."""

VERBS = ("run", "status", "verify", "show", "report")


def run(sizes: Sizes) -> Result:
    """CPU seconds and peak memory of every verb, files and bytes, for studies of growing size.

    With ``sizes.folder`` cubes and measurements are kept there, and a repeated call continues with what is missing.
    """
    result = Result("scale")
    with ExitStack() as stack:
        folder = sizes.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        for wanted in sizes.scale:
            row = _measured(folder, wanted)
            result.table.append(_shown(row))
            result.keys |= {f"scale.{key}.{wanted}": value for key, value in row.items() if key != "fits"}
    result.notes.append("fits are drawn at random, not computed; one worker; every verb is a process of its own")
    result.figure = partial(draw, result.table)
    return result


def text(fits: int) -> str:
    """A study file of about that many fits."""
    return study_text(max(1, round(fits / (len(FMAX) * STARTS * 2))), STARTS, FMAX, AMPLITUDES)


def _measured(folder: Path, wanted: int) -> dict[str, float]:
    """Everything about one size; each verb is written to a file as soon as it was measured."""
    path, out, file = (folder / f"{wanted}{end}" for end in (".toml", ".zarr", ".json"))
    path.write_text(text(wanted))
    study = parse_study(path.read_text())
    row: dict[str, float] = json.loads(file.read_text()) if file.exists() else {"fits": study.fits}
    commands = {
        "run": instant("run", path, "-o", out, "--workers", "1"),
        "status": mcstudy("status", out),
        "verify": instant("verify", out),
        "show": mcstudy("show", out),
        "report": mcstudy("report", out, "-o", folder / f"{wanted}.html"),
    }
    for verb in VERBS:
        if f"{verb}_cpu_s" in row:
            continue
        shutil.rmtree(cache.folder(out), ignore_errors=True)  # a first look
        used = run_command(*commands[verb])
        row |= {f"{verb}_cpu_s": used.cpu, f"{verb}_peak_bytes": used.peak}
        file.write_text(json.dumps(row))
    row |= _on_disk(out, study)
    file.write_text(json.dumps(row))
    return row


def _on_disk(out: Path, study: Study) -> dict[str, float]:
    """Files and bytes of a cube, and the tasks of its run, beside what the plan says."""
    found = [file.stat().st_size for file in out.rglob("*") if file.is_file()]
    log = (json.loads(line) for line in (out.parent / f"{out.name}.log" / "runs.jsonl").read_text().splitlines())
    tasks = sum(event["event"] == "block" for event in log)
    planned = extent(study, threads=1)
    return {
        "files": len(found),
        "files_planned": planned.files,
        "bytes": sum(found),
        "tasks": tasks,
        "tasks_planned": planned.tasks,
    }


def _shown(row: dict[str, float]) -> dict[str, Any]:
    """A row of the table: seconds, MB."""
    out: dict[str, Any] = {"fits": int(row["fits"]), "us a fit": 1e6 * row["run_cpu_s"] / row["fits"]}
    out |= {key: int(row[key]) for key in ("tasks", "tasks_planned", "files", "files_planned")}
    out["MB"] = row["bytes"] / 1e6
    for verb in VERBS:
        if f"{verb}_cpu_s" in row:
            out |= {f"{verb} CPU s": row[f"{verb}_cpu_s"], f"{verb} peak MB": row[f"{verb}_peak_bytes"] / 1e6}
    return out


def draw(table: list[dict[str, Any]], file: Path) -> None:
    """Three panels over the number of fits, both axes logarithmic: memory, CPU seconds, files and tasks."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.8), layout="constrained")
    panels = figure.subplots(1, 3)
    fits = np.array([row["fits"] for row in table])
    of_verbs: dict[str, Callable[[dict[str, Any], str], float]] = {
        "peak memory, MB": lambda row, verb: row.get(f"{verb} peak MB", np.nan),
        "CPU time, s": lambda row, verb: row.get(f"{verb} CPU s", np.nan),
    }
    for ax, (label, of) in zip(panels, of_verbs.items(), strict=False):
        for verb in VERBS:
            ax.plot(fits, [of(row, verb) for row in table], "o-", label=verb)
        ax.set_ylabel(label)
    for name in ("files", "tasks"):
        (line,) = panels[2].plot(fits, [row[name] for row in table], "o", label=f"{name}, found")
        panels[2].plot(fits, [row[f"{name}_planned"] for row in table], "-", color=line.get_color(), label="planned")
    panels[2].set_ylabel("number")
    for ax in panels:
        ax.set(xscale="log", yscale="log", xlabel="fits")
        ax.legend(fontsize="small")
    figure.savefig(file)
