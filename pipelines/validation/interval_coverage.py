"""How often do the 95 % intervals of ``mcstudy fit`` contain the true values?

    python pipelines/validation/interval_coverage.py pipelines/validation/interval_coverage.toml -o results/coverage

Recordings are drawn in the frequency domain (`pipelines.validation.coverage`). Whether an interval contains the true
value is decided by a fit with the quantity at that value (`pipelines.validation.at_truth`). ``--ends`` does what
``mcstudy fit`` does, the search for all minima and both ends of every interval, at ten times the cost, and counts how
often the two answers differ. ``--open`` shows what the bounds of the fit do. ``--with EFFECT=SIZE`` gives the bodies an
effect, which the fits estimate as ``mcstudy fit --with`` does. ``--time-domain`` also simulates and
measures the recordings sample by sample.

Every block of realizations is a file in the output folder, so the same command resumes. At the end ``coverage.nc``
(``coverage_ends.nc``, ``coverage_open.nc``) holds everything by label, and a table is printed: percentage of intervals
that contain the truth, and for all quantities the same with the threshold of a known noise ("uncorrected").
``--csv FILE`` writes what ``mcstudy fit`` tells of coverage (`mcstudy.identification.simulated_coverage`).
The standard error of 95 % among n intervals is sqrt(0.95 x 0.05 / n).
"""

from __future__ import annotations

import argparse
import csv
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
from scipy.stats import chi2

from mcstudy import text_tables
from mcstudy.effect_library.library import apply
from mcstudy.errors import InputError
from mcstudy.files.durable import replacing
from mcstudy.fitting.compilers import cores
from mcstudy.identification.simulated_coverage import Covered
from mcstudy.models.quantities import quantities
from mcstudy.stance.body import two_segment
from pipelines.validation.coverage import (
    ABOUT,
    COLUMNS,
    JUDGED,
    LEVEL,
    Condition,
    intervals,
    judgements,
    opened,
    truths,
)

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""The matrices are small: threads of the linear algebra would cost more than they save."""

FIELDS = {"realizations": int, "truths": list, "cycles": list, "amplitude": list, "fmax": list, "block": int}


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


KINDS = {"judged": "coverage", "ends": "coverage_ends", "open": "coverage_open"}
"""What a block may hold, and the name of the file with all of them."""

Job = tuple[int, int, float, int, int]
"""Number of the body, cycles, peak of the torque (N m), first realization, and the one after the last."""


def block(
    job: Job,
    fmax: list[float],
    folder: Path,
    kind: str,
    time_domain: bool = False,
    effects: dict[str, float] | None = None,
) -> float:
    """Fit one block of a `KINDS` and write it; returns the CPU seconds it took."""
    path = place(folder, job, kind, effects)
    if path.exists():
        return 0.0
    began = time.process_time()
    truth, cycles, amplitude, first, last = job
    found: dict[str, np.ndarray] = {}
    if kind == "ends":
        for highest in fmax:
            one = intervals(Condition(truth, cycles, highest, amplitude), first, last, time_domain)
            found |= {f"{highest:g} {name}": values for name, values in one.items()}
    if not time_domain:
        bounds = opened() if kind == "open" else None
        answers = judgements(truth, cycles, fmax, first, last, bounds, effects, amplitude)
        found |= {f"{highest:g} judged": x for highest, x in answers.items()}
    with replacing(path) as file:
        np.savez(file, **found)
    return time.process_time() - began


def place(folder: Path, job: Job, kind: str, effects: dict[str, float] | None = None) -> Path:
    """The file of a block."""
    truth, cycles, amplitude, first, last = job
    added = "".join(f"_{name}_{size:g}" for name, size in (effects or {}).items())
    return folder / f"{kind}{added}_truth{truth}_cycles{cycles}_torque{amplitude:g}_{first}_{last}.npz"


def collect(
    settings: dict[str, Any], folder: Path, jobs: list[Job], kind: str, effects: dict[str, float] | None = None
) -> xr.Dataset:
    """Everything in the blocks, by (truth, cycles, amplitude, fmax, realization, quantity), with the true values."""
    names = [q.name for q in quantities(apply(two_segment(), *(effects or {})))]
    axes = [settings[a] for a in ("truths", "cycles", "amplitude", "fmax")]
    shape = *map(len, axes), settings["realizations"]
    kept = {"intervals": COLUMNS, "about": ABOUT, "judged": JUDGED}
    found: dict[str, np.ndarray] = {}
    for job in jobs:
        truth, cycles, amplitude, first, last = job
        where = axes[0].index(truth), axes[1].index(cycles), axes[2].index(amplitude)
        with np.load(place(folder, job, kind, effects)) as stored:
            for (f, highest), (part, columns) in product(enumerate(axes[3]), kept.items()):
                if (values := stored.get(f"{highest:g} {part}")) is None:
                    continue
                at = *where, f, slice(first, last)
                for i, column in enumerate(columns):
                    if part == "judged" and kind == "ends" and column != "contained":
                        continue
                    whole = found.setdefault(column, np.full((*shape, *values.shape[1:-1]), np.nan))
                    whole[at] = values[..., i]
    dims = ("truth", "cycles", "amplitude", "fmax", "realization", "quantity")
    data: dict[str, Any] = {name: (dims[: values.ndim], values) for name, values in found.items()}
    data["true_value"] = (("truth", "quantity"), np.array([truths(t, names, effects) for t in axes[0]]))
    coords = {"truth": axes[0], "cycles": axes[1], "amplitude": axes[2], "fmax": axes[3], "quantity": names}
    return xr.Dataset(data, coords, attrs={"level": LEVEL})


def table(data: xr.Dataset) -> str:
    """Percentage of intervals that contain the truth; in brackets Wald, and intervals ended by data on both sides."""
    true = data.true_value
    parts = [data.get("contained"), (data.wald_low <= true) & (true <= data.wald_high)]
    if ends := "low" in data:
        parts[0] = (data.low <= true) & (true <= data.high)
        parts.append((data.low_by_data == 1) & (data.high_by_data == 1))
    held, n = parts[0], data.sizes["realization"]
    lines = [f"{n} realizations of each of {data.sizes['truth']} bodies", ""]
    columns = list(product(data.amplitude.values, data.cycles.values, data.fmax.values))
    rows = []
    for name in [*data.quantity.values, "mean"]:
        row = [str(name)]
        for a, c, f in columns:
            cell = [x.sel(amplitude=a, cycles=c, fmax=f) for x in parts]
            if name != "mean":
                cell = [x.sel(quantity=name) for x in cell]
            first, *others = (100 * float(x.mean()) for x in cell)
            row.append(f"{first:.1f} ({'; '.join(f'{x:.0f}' for x in others)})")
        rows.append(row)
    if "rise" in data:
        rises = [data.rise.sel(amplitude=a, cycles=c, fmax=f) for a, c, f in columns]
        rows.append(["uncorrected", *(f"{100 * float((x <= chi2.ppf(LEVEL, 1)).mean()):.1f}" for x in rises)])
    lines.append(text_tables.table(["quantity", *(f"{a:g} N m, {c} cycles, {f:g} Hz" for a, c, f in columns)], rows))
    by_body = held.mean("realization") * 100
    low, high = by_body.min(("truth",)), by_body.max(("truth",))
    lines += ["", f"by body: {float(low.min()):.1f} to {float(high.max()):.1f} %"]
    if ends:
        lines.append(f"not converged: {100 * float(((data.low_by_data < 0) | (data.high_by_data < 0)).mean()):.2f} %")
        lines.append(f"goodness of fit below 0.05: {100 * float((data.p_value < 0.05).mean()):.1f} % of recordings")
    if ends and "contained" in data:
        only = [100 * float(x.mean()) for x in (held & (data.contained == 0), ~held & (data.contained == 1))]
        lines.append(
            f"the interval holds the truth and the test does not: {only[0]:.2f} %; the reverse: {only[1]:.2f} %"
        )
    return "\n".join(lines)


def _effect(text: str) -> dict[str, float]:
    name, _, size = text.partition("=")
    return {name: float(size)}


def write_csv(data: xr.Dataset, path: Path) -> None:
    """Percent of intervals that contain the truth by condition and quantity: all bodies, and the extreme ones."""
    by_body = 100 * data.contained.mean("realization")
    cells = by_body.mean("truth"), by_body.min("truth"), by_body.max("truth")
    n = data.sizes["realization"] * data.sizes["truth"]
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["amplitude", "cycles", "fmax", "realizations", "quantity", *Covered._fields])
        axes = (data[name].values for name in ("amplitude", "cycles", "fmax", "quantity"))
        for a, c, f, q in product(*axes):
            percent = [f"{float(x.sel(amplitude=a, cycles=c, fmax=f, quantity=q)):.2f}" for x in cells]
            rows.writerow([f"{a:g}", c, f"{f:g}", n, q, *percent])


def main() -> None:
    """Fit what is missing, collect, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="settings, TOML")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    parser.add_argument("--realizations", type=int, help="fewer (or more) than the file says")
    parser.add_argument("--ends", action="store_true", help="search the ends of every interval, as mcstudy fit does")
    parser.add_argument("--open", action="store_true", help="with bounds so wide that a fit rarely ends on one")
    parser.add_argument(
        "--with", dest="effect", type=_effect, metavar="EFFECT=SIZE", help="bodies with an effect, which is fitted too"
    )
    parser.add_argument("--time-domain", action="store_true", help="with --ends: simulate sample by sample")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="also write the coverage of each quantity as a table")
    parser.add_argument("--workers", type=int, default=cores(), help="processes (default: one per core)")
    args = parser.parse_args()
    try:
        settings = read(args.file)
    except InputError as error:
        parser.error(str(error))
    if args.realizations:
        settings["realizations"] = args.realizations
    if args.time_domain and not args.ends:
        parser.error("--time-domain: expected --ends as well")
    if args.ends and args.open:
        parser.error("--open: expected no --ends")
    if args.effect and args.ends:
        parser.error("--with: expected no --ends")
    if args.csv and (args.ends or args.open or args.effect):
        parser.error("--csv: expected none of --ends, --open and --with")
    kind = "ends" if args.ends else "open" if args.open else "judged"
    n, size = settings["realizations"], settings["block"]
    bodies = list(product(settings["truths"], settings["cycles"], settings["amplitude"]))
    jobs = [(*body, k, min(k + size, n)) for k in range(0, n, size) for body in bodies]
    args.output.mkdir(parents=True, exist_ok=True)
    run = partial(
        block, fmax=settings["fmax"], folder=args.output, kind=kind, time_domain=args.time_domain, effects=args.effect
    )
    os.environ |= dict.fromkeys(ONE_THREAD, "1")  # read by the new processes
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        seconds = sum(pool.map(run, jobs))
    data = collect(settings, args.output, jobs, kind, args.effect)
    data.to_netcdf(args.output / f"{KINDS[kind]}{'_with' if args.effect else ''}.nc")
    if args.csv:
        write_csv(data, args.csv)
    print(table(data))
    if seconds:
        print(f"CPU time: {seconds:.0f} s, {1000 * seconds / data.estimate[..., 0].size:.1f} ms per recording")


if __name__ == "__main__":
    main()
