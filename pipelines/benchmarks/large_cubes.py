"""Statistics of large cubes, which the store's own writer fills with numbers drawn at random instead of fitted."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from mcstudy.analysis import cache
from mcstudy.study.cube.store import Cube
from mcstudy.study.study_file import parse_study
from pipelines.benchmarks.cases import study_text
from pipelines.benchmarks.invented import invented
from pipelines.benchmarks.measure import mcstudy, run_command
from pipelines.benchmarks.report import Result, Sizes

FMAX, STARTS = (0.41, 1.2, 8.0), 50
"""Axes of the paper's accuracy group; realizations make the size."""


def run(sizes: Sizes) -> Result:
    """CPU seconds and peak memory of ``show``, first and again, and of ``report``, for cubes of growing size."""
    result = Result("show")
    with tempfile.TemporaryDirectory() as name:
        for wanted in sizes.fits:
            cube = Path(name) / f"{wanted}.zarr"
            fits = write_cube(cube, wanted)
            first, again = (run_command(*mcstudy("show", cube)) for _ in range(2))
            if first.output != again.output:
                raise RuntimeError(f"{wanted} fits: the second look printed something else than the first")
            shutil.rmtree(cache.folder(cube))
            report = run_command(*mcstudy("report", cube, "-o", Path(name) / "page.html"))
            result.table.append(
                {
                    "fits": fits,
                    "first CPU s": first.cpu,
                    "first peak MB": first.peak / 1e6,
                    "again CPU s": again.cpu,
                    "again peak MB": again.peak / 1e6,
                    "report CPU s": report.cpu,
                    "report peak MB": report.peak / 1e6,
                }
            )
            result.keys[f"show.first_cpu_s.{wanted}"] = first.cpu
            result.keys[f"show.first_peak_bytes.{wanted}"] = first.peak
            result.keys[f"show.again_cpu_s.{wanted}"] = again.cpu
            result.keys[f"show.report_cpu_s.{wanted}"] = report.cpu
            result.keys[f"show.report_peak_bytes.{wanted}"] = report.peak
    return result


def write_cube(path: Path, fits: int) -> int:
    """A complete cube of about ``fits`` fits at ``path``; returns their exact number."""
    study = parse_study(study_text(max(1, round(fits / (len(FMAX) * STARTS))), STARTS, FMAX))
    cube = Cube.create(path, study)
    for store in cube.groups.values():
        for chunk in store.layout.chunks:
            store.write(chunk, invented(store, chunk))
    return study.fits
