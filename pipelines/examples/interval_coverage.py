"""How often do the 95 % intervals of ``mcstudy fit`` contain the true values?

    python pipelines/examples/interval_coverage.py pipelines/examples/interval_coverage.toml -o results/coverage

Recordings are drawn in the frequency domain (`mcstudy.identification.coverage`); ``--time-domain`` simulates and
measures them sample by sample. Every block of realizations is a file in the output folder, so the same command resumes.
At the end ``coverage.nc`` holds all intervals by label, and a table is printed: percentage of intervals that contain
the truth. The standard error of 95 % among n intervals is sqrt(0.95 x 0.05 / n).
"""

from __future__ import annotations

import argparse
import os
import time
import tomllib
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.files.durable import replacing
from mcstudy.fitting.compilers import cores
from mcstudy.identification.coverage import ABOUT, COLUMNS, Condition, intervals, truths
from mcstudy.identification.quantities import quantities
from mcstudy.stance.body import two_segment

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""The matrices are small: threads of the linear algebra would cost more than they save."""

FIELDS = {"realizations": int, "truths": list, "cycles": list, "fmax": list, "block": int}


def read(path: Path) -> dict[str, Any]:
    """The settings of a coverage study; raises `InputError` for a wrong one."""
    try:
        with path.open("rb") as file:
            settings = tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: expected a readable TOML file: {error}") from None
    if settings.keys() != FIELDS.keys():
        raise InputError(f"{path}: expected the fields {', '.join(FIELDS)}, got {', '.join(settings)}")
    for name, kind in FIELDS.items():
        if not isinstance(settings[name], kind) or not settings[name]:
            raise InputError(f"{path}: {name}: expected {'a number' if kind is int else 'a list'} that is not empty")
    return settings


def block(job: tuple[Condition, int, int], folder: Path, time_domain: bool) -> float:
    """Fit one block and write it; returns the CPU seconds it took."""
    condition, first, last = job
    path = place(folder, job)
    if path.exists():
        return 0.0
    began = time.process_time()
    found = intervals(condition, first, last, time_domain)
    with replacing(path) as file:
        np.savez(file, **found)
    return time.process_time() - began


def place(folder: Path, job: tuple[Condition, int, int]) -> Path:
    """The file of a block."""
    c, first, last = job
    return folder / f"truth{c.truth}_cycles{c.cycles}_fmax{c.fmax:g}_{first}_{last}.npz"


def collect(settings: dict[str, Any], folder: Path, jobs: list[tuple[Condition, int, int]]) -> xr.Dataset:
    """All intervals, by (truth, cycles, fmax, realization, quantity), with the true values."""
    names = [q.name for q in quantities(two_segment())]
    axes = [settings[a] for a in ("truths", "cycles", "fmax")]
    shape = *map(len, axes), settings["realizations"]
    found, about = np.full((*shape, len(names), len(COLUMNS)), np.nan), np.full((*shape, len(ABOUT)), np.nan)
    for job in jobs:
        c, first, last = job
        at = axes[0].index(c.truth), axes[1].index(c.cycles), axes[2].index(c.fmax), slice(first, last)
        with np.load(place(folder, job)) as stored:
            found[at], about[at] = stored["intervals"], stored["about"]
    dims = ("truth", "cycles", "fmax", "realization")
    data = {name: ((*dims, "quantity"), found[..., i]) for i, name in enumerate(COLUMNS)}
    data |= {name: (dims, about[..., i]) for i, name in enumerate(ABOUT)}
    data["true_value"] = (("truth", "quantity"), np.array([truths(t, names) for t in axes[0]]))
    coords = {"truth": axes[0], "cycles": axes[1], "fmax": axes[2], "quantity": names}
    return xr.Dataset(data, coords, attrs={"level": 0.95})


def table(data: xr.Dataset) -> str:
    """Percentage of intervals that contain the truth; in brackets Wald, and intervals ended by data on both sides."""
    true = data.true_value
    held = (data.low <= true) & (true <= data.high)
    wald = (data.wald_low <= true) & (true <= data.wald_high)
    both = (data.low_by_data == 1) & (data.high_by_data == 1)
    lines = [f"{data.sizes['realization']} realizations of each of {data.sizes['truth']} bodies", ""]
    columns = list(product(data.cycles.values, data.fmax.values))
    lines.append("".join([f"{'quantity':14}", *(f"{f'{c} cycles, {f:g} Hz':>22}" for c, f in columns)]))
    for name in [*data.quantity.values, "mean"]:
        row = f"{name:14}"
        for c, f in columns:
            parts = [x.sel(cycles=c, fmax=f) for x in (held, wald, both)]
            if name != "mean":
                parts = [x.sel(quantity=name) for x in parts]
            h, w, i = (100 * float(x.mean()) for x in parts)
            row += f"{h:.1f} ({w:.0f}; {i:.0f})".rjust(22)
        lines.append(row)
    by_body = held.mean("realization") * 100
    low, high = by_body.min(("truth",)), by_body.max(("truth",))
    lines += ["", f"by body: {float(low.min()):.1f} to {float(high.max()):.1f} %"]
    lines.append(f"not converged: {100 * float(((data.low_by_data < 0) | (data.high_by_data < 0)).mean()):.2f} %")
    lines.append(f"goodness of fit below 0.05: {100 * float((data.p_value < 0.05).mean()):.1f} % of recordings")
    return "\n".join(lines)


def main() -> None:
    """Fit what is missing, collect, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="settings, TOML")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    parser.add_argument("--realizations", type=int, help="fewer (or more) than the file says")
    parser.add_argument("--time-domain", action="store_true", help="simulate recordings sample by sample")
    parser.add_argument("--workers", type=int, default=cores(), help="processes (default: one per core)")
    args = parser.parse_args()
    try:
        settings = read(args.file)
    except InputError as error:
        parser.error(str(error))
    if args.realizations:
        settings["realizations"] = args.realizations
    n, size = settings["realizations"], settings["block"]
    conditions = [Condition(*c) for c in product(settings["truths"], settings["cycles"], settings["fmax"])]
    jobs = [(c, first, min(first + size, n)) for first in range(0, n, size) for c in conditions]
    args.output.mkdir(parents=True, exist_ok=True)
    run = partial(block, folder=args.output, time_domain=args.time_domain)
    os.environ |= dict.fromkeys(ONE_THREAD, "1")  # read by the new processes
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        seconds = sum(pool.map(run, jobs))
    data = collect(settings, args.output, jobs)
    data.to_netcdf(args.output / "coverage.nc")
    print(table(data))
    if seconds:
        print(f"CPU time: {seconds:.0f} s")


if __name__ == "__main__":
    main()
