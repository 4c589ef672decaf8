"""Limits for a study of a billion fits: scheduler, files, bytes."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from distributed import Client

from mcstudy.files.durable import write
from mcstudy.fitting.status import Status
from mcstudy.scheduler.cluster import ClusterOptions, connect
from mcstudy.study.cube.store import Cube
from mcstudy.study.execution.tasks import fill
from mcstudy.study.study_file import parse_study
from pipelines.benchmarks.cases import study_text
from pipelines.benchmarks.report import Result, Sizes
from pipelines.benchmarks.studies import cluster

FILE_BYTES = 64_000


def _nothing(_: int) -> None:
    return None


def _tasks_a_second(client: Client, n: int) -> float:
    client.gather(client.map(_nothing, range(50), pure=False))
    begun = time.perf_counter()
    client.gather(client.map(_nothing, range(n), pure=False))
    return n / (time.perf_counter() - begun)


def run(sizes: Sizes) -> Result:
    """Empty tasks per second, synced files per second, seconds and bytes of one chunk."""
    result = Result("limits")
    with connect(ClusterOptions(workers=2)) as client:
        rates = [_tasks_a_second(client, sizes.tasks) for _ in range(sizes.repeats)]
        result.keys["limits.tasks_per_s.threads"] = float(np.median(rates))
    with cluster(2) as address, Client(address, set_as_default=False) as client:
        rates = [_tasks_a_second(client, sizes.tasks) for _ in range(sizes.repeats)]
        result.keys["limits.tasks_per_s.processes"] = float(np.median(rates))
    with tempfile.TemporaryDirectory() as name:
        folder, content = Path(name), np.random.default_rng(0).bytes(FILE_BYTES)
        begun = time.perf_counter()
        for k in range(sizes.files):
            write(folder / f"{k}", content)
        result.keys["limits.synced_files_per_s"] = sizes.files / (time.perf_counter() - begun)
        for fits in (500, 5000):
            result.table.append(_chunk(folder, fits, max(2, sizes.files // 40)))
    for row in result.table:
        result.keys[f"limits.write_us_per_fit.chunk_{row['fits a chunk']}"] = row["write us a fit"]
    result.keys["limits.bytes_per_fit"] = result.table[-1]["bytes a fit"]
    return result


def _chunk(folder: Path, fits: int, repeats: int) -> dict[str, float]:
    """Filling and writing chunks of about ``fits`` fits, each to a place of its own."""
    fmax, starts = (0.41, 1.2, 8.0), 50
    depth = max(1, round(fits / (len(fmax) * starts)))
    study = parse_study(study_text(depth * repeats, starts, fmax))
    cube = Cube.create(folder / f"chunks_{fits}.zarr", study, depths={"accuracy": depth})
    store = cube.groups["accuracy"]
    data = store.layout.empty(store.layout.chunks[0])
    fill(store.experiment, store.layout, store.layout.chunks[0], data)
    done = int((data["status"] != Status.PENDING).sum())
    seconds = []
    for chunk in store.layout.chunks:
        begun = time.perf_counter()
        store.write(chunk, data)
        seconds.append(time.perf_counter() - begun)
    first = store.layout.chunks[0]
    size = sum(store.chunk_file(name, first).stat().st_size for name in store.layout.results)
    return {
        "fits a chunk": done,
        "files": len(store.layout.results),
        "write ms": 1e3 * float(np.median(seconds)),
        "write us a fit": 1e6 * float(np.median(seconds)) / done,
        "bytes a fit": size / done,
    }
