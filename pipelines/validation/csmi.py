"""What does the sensorimotor integration test determine, by tilt, cycles and bandwidth? Runs ``pipelines/csmi.toml``.

    python pipelines/validation/csmi.py --json pipelines/measured/csmi.json

Prints for every cell the coefficients of variation with the largest bias, the lowest coverage of 95 % intervals
(estimate and 1.96 standard errors) and the starts that nine of ten records need.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import xarray as xr

import mcstudy as mc
from pipelines import measured

STUDY = Path(__file__).parents[1] / "csmi.toml"
TITLES = {
    "surface": "surface, 10 cycles of 20 s",
    "few_cycles": "surface, 3 cycles of 20 s",
    "long_cycles": "surface, 3 cycles of 60.5 s",
    "scene": "scene, 10 cycles of 20 s",
}


def rows(name: str, group: xr.Dataset) -> list[list[str]]:
    """A row for every amplitude and Fmax."""
    cells = group.mc.best()
    bias, cv = cells.mc.bias(), cells.mc.cv()
    coverage = group.mc.performance().sel(measure="coverage")["value"]
    starts = group.mc.starts_needed_quantiles()["value"]
    found = []
    for a, amplitude in enumerate(group["amplitude"].values):
        for f, fmax in enumerate(group["fmax"].values):
            at = {"amplitude": a, "fmax": f}
            spread = [f"{100 * float(x):.2g}" for x in cv["value"].isel(at)]
            relative = (bias["value"].isel(at) / group["truth"]).load()
            worst = int(np.abs(relative.values).argmax())
            held = coverage.isel(at)
            lowest = int(held.values.argmin())
            share = float(held[lowest]) * (100 if float(held.max()) <= 1 else 1)
            found.append(
                [
                    TITLES[name],
                    f"{np.degrees(amplitude):.0f}",
                    f"{fmax:g}",
                    *spread,
                    f"{100 * float(relative[worst]):.1f} ({group['parameter'].values[worst]})",
                    f"{share:.0f} ({group['parameter'].values[lowest]})",
                    f"{float(starts.isel(at).sel(quantile=0.9)):.0f}",
                ]
            )
    return found


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measured.add_option(parser)
    args = parser.parse_args()
    with TemporaryDirectory() as folder:
        tree = mc.run(mc.read_study(STUDY), Path(folder) / "cube.zarr")
        table = [row for name, node in tree.children.items() for row in rows(name, node.to_dataset().load())]
    header = ["record", "tilt, ° p-p", "Fmax, Hz", "Kp", "Kd", "delay", "Kt", "weight"]
    header = [*header, "largest bias, %", "lowest coverage, %", "starts for 90 %"]
    print(*(" | ".join(row) for row in (header, *table)), sep="\n")
    measured.write(args.json, {}, {"cells": (header, table)})


if __name__ == "__main__":
    main()
