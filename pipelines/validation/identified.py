"""How many parameters does a study determine? python pipelines/validation/identified.py three_segments pasma2017

Runs studies of ``pipelines`` and prints, for every group and Fmax: how many parameters have a coefficient of variation
below 20 %, in the simulation and by the Cramér-Rao bound; medians of both; how many best fits are unstable loops; and
the starts that 95 % certainty of the lowest minimum needs. Then the coefficient of variation of every parameter at the
largest Fmax, by group. Amplitude: the last of each group.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr

import mcstudy as mc
from pipelines import measured

FOLDER = Path(__file__).parents[1]
DETERMINED = 0.2
HEADER = (
    "group", "Fmax, Hz", "CV < 20 %", "median CV, %", "bound < 20 %", "median bound, %", "unstable, %",
    "starts, median", "starts, 90 %",
)  # fmt: skip


def conditions(name: str, group: xr.Dataset) -> list[list[str]]:
    """One row for each Fmax of a group with one amplitude."""
    cv, unstable = (x["value"].isel(amplitude=0) for x in (group.mc.cv(), group.mc.unstable()))
    bound = group.mc.efficiency()["cramer_rao_sd"].isel(amplitude=0) / abs(group["truth"])
    starts = group.mc.starts_needed_quantiles()["value"].isel(amplitude=0)
    found = []
    for fmax in group["fmax"].values:
        c, b = cv.sel(fmax=fmax).values, bound.sel(fmax=fmax).values
        known = bool(np.isfinite(b).all())
        found.append(
            [
                name,
                f"{fmax:g}",
                f"{(c < DETERMINED).sum()} of {c.size}",
                f"{100 * np.median(c):.3g}",
                f"{(b < DETERMINED).sum()} of {b.size}" if known else "–",
                f"{100 * np.median(b):.3g}" if known else "–",
                f"{100 * float(unstable.sel(fmax=fmax)):.0f}",
                *(f"{float(starts.sel(fmax=fmax, quantile=q)):.0f}" for q in (0.5, 0.9)),
            ]
        )
    return found


def parameters(groups: dict[str, xr.Dataset]) -> list[list[str]]:
    """CV and its Monte Carlo error at the largest Fmax, in percent: parameters by groups, in their order."""
    columns = []
    for group in groups.values():
        cv = group.mc.cv().isel(amplitude=0, fmax=-1)
        columns.append(
            [f"{100 * v:.2g} ± {100 * e:.1g}" for v, e in zip(cv["value"].values, cv["mcse"].values, strict=True)]
        )
    first = next(iter(groups.values()))
    names = ["W" if n in ("Wp", "Wv") else str(n) for n in first["parameter"].values]
    return [[n, *row] for n, row in zip(names, zip(*columns, strict=True), strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("studies", nargs="+", metavar="STUDY", help="name of a study in pipelines")
    measured.add_option(parser)
    args = parser.parse_args()
    tables = {}
    for study in args.studies:
        with TemporaryDirectory() as folder:
            tree = mc.run(mc.read_study(FOLDER / f"{study}.toml"), Path(folder) / "cube.zarr")
            groups = {str(n): g.to_dataset().isel(amplitude=[-1]).load() for n, g in tree.children.items()}
        tables[study] = (HEADER, [row for name, g in groups.items() for row in conditions(name, g)])
        tables[f"{study}_parameters"] = (("", *(f"CV, %: {name}" for name in groups)), parameters(groups))
        for key in (study, f"{study}_parameters"):
            print(key, *("  ".join(row) for row in (tables[key][0], *tables[key][1])), sep="\n  ", flush=True)
    measured.write(args.json, {}, tables)


if __name__ == "__main__":
    main()
