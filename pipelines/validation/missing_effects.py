"""The atlas of missing effects: what ignoring each does to every parameter, and what can be trusted anyhow.

    mcstudy run pipelines/missing_effects.toml -o results/missing_effects.zarr
    python pipelines/validation/missing_effects.py results/missing_effects.zarr --figure pipelines/missing_effects.svg

Bias is the mean estimate minus the truth, in percent of the truth and in standard deviations of the estimates of the
same cell. A parameter is *held* in a cell if its bias is below one standard deviation and below 10 %.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from mcstudy.analysis.show.sweeps import sweeps_of
from mcstudy.analysis.show.tables import show
from mcstudy.report.figures.sweep import bias_map, parameters_of, relative_bias, size_of_map
from pipelines import measured

SMALL = {"sd": 1.0, "percent": 10.0}
"""Largest bias of a parameter that is held."""


def cells_of(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Cells of all sweeps of the study in which bodies stood."""
    every = [cell for cells in sweeps_of(data["groups"]).values() for cell in cells]
    return [cell for cell in every if stood(cell)]


def stood(cell: dict[str, Any]) -> bool:
    """Whether most realizations have a fit at every amplitude and Fmax: a body that falls has no responses."""
    return all(2 * c["realizations"]["used"] > cell["design"]["realizations"] for c in cell["cells"])


def held(cells: list[dict[str, Any]], condition: int, names: list[str]) -> np.ndarray:
    """Which parameters (C, P) are held in which cells."""
    inside = [np.abs(relative_bias(cells, condition, names, unit)[0]) < most for unit, most in SMALL.items()]
    return np.asarray(inside[0] & inside[1])


def coverage(cells: list[dict[str, Any]], condition: int) -> float:
    """Mean share of 95 % intervals of single parameters that hold the truth, in percent."""
    each = [p["coverage"]["value"] for c in cells for p in c["cells"][condition]["parameters"] if "coverage" in p]
    return 100 * float(np.mean([x for x in each if x is not None]))


def trusted(cells: list[dict[str, Any]], names: list[str]) -> tuple[list[str], list[list[object]]]:
    """Per parameter: in how many cells it is held at either Fmax, its median and its largest bias, by which effect."""
    conditions = {f"{cells[0]['cells'][k]['fmax']:g} Hz": k for k in _conditions(cells)}
    rows: list[list[object]] = []
    for j, name in enumerate(names):
        shares = [f"{int(held(cells, k, names)[:, j].sum())} of {len(cells)}" for k in conditions.values()]
        percent = relative_bias(cells, -1, [name], "percent")[0][:, 0]
        worst = int(np.nanargmax(np.abs(percent)))
        at = " ".join(map(str, cells[worst]["cell"]["at"].values()))
        rows.append([name, *shares, f"{np.nanmedian(np.abs(percent)):.0f}", f"{percent[worst]:+.0f} ({at})"])
    rows.sort(key=lambda row: -int(str(row[2]).split()[0]))
    return ["parameter", *(f"held, {f}" for f in conditions), "median |bias| %", "largest bias %"], rows


def _conditions(cells: list[dict[str, Any]]) -> list[int]:
    """Positions of the largest amplitude at each Fmax."""
    at = cells[0]["cells"]
    largest = max(c["amplitude"] for c in at)
    return [k for k, c in enumerate(at) if c["amplitude"] == largest]


def worst_of(cells: list[dict[str, Any]], names: list[str]) -> tuple[list[str], list[list[object]]]:
    """Per effect and size: bias of K11, its sum and the most biased parameter, coverage, and parameters held."""
    inside, percent = held(cells, -1, names), relative_bias(cells, -1, names, "percent")[0]
    rows: list[list[object]] = []
    for i, cell in enumerate(cells):
        worst = int(np.nanargmax(np.abs(percent[i])))
        share = f"{int(inside[i].sum())} of {len(names)}"
        at = list(map(str, cell["cell"]["at"].values()))
        most = f"{names[worst]} {percent[i, worst]:+.0f}"
        k11, both = (percent[i, names.index(n)] for n in ("K11", "K11+Kpas1"))
        rows.append([*at, f"{k11:+.0f}", f"{both:+.0f}", most, f"{coverage([cell], -1):.0f}", share])
    return ["effect", "size", "K11 %", "K11 + Kpas1 %", "most biased %", "coverage %", "held"], rows


def draw(cells: list[dict[str, Any]], file: Path) -> None:
    """The atlas: every cell by every parameter, in standard deviations and in percent."""
    width, height = size_of_map(cells)
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "missing effects", "font.family": "sans-serif"})
    figure, (left, right) = plt.subplots(1, 2, figsize=(2 * width - 2.2, height), sharey=True, layout="constrained")
    bias_map(cells, -1, "sd", left).set_title("bias, SDs of the estimates")
    bias_map(cells, -1, "percent", right).set_title("bias, % of the truth")
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


def main(cube: Path, figure: Path | None, file: Path | None = None) -> None:
    """Print the tables, draw the figure, and write the numbers to ``file``."""
    data = show(cube).data
    cells = cells_of(data)
    names = [n for n in parameters_of(cells) if n in {p["name"] for p in cells[0]["cells"][-1]["parameters"]}]
    tables = {"effects": worst_of(cells, names), "parameters": trusted(cells, names)}
    for head, rows in tables.values():
        print("\t".join(head), *("\t".join(map(str, row)) for row in rows), sep="\n", end="\n\n")
    falls = [c["cell"]["at"] for cells_ in sweeps_of(data["groups"]).values() for c in cells_ if not stood(c)]
    print(f"bodies that fall, left out: {'; '.join(' '.join(map(str, at.values())) for at in falls) or 'none'}")
    without = [data["groups"]["none"]]
    inside = held(cells, -1, names)
    values = {
        "cells": {"value": len(cells)},
        "coverage": {"value": coverage(cells, -1), "unit": "%"},
        "coverage_without": {"value": coverage(without, -1), "unit": "%"},
        "held": {"value": 100 * float(inside.mean()), "unit": "%"},
        "held_without": {"value": 100 * float(held(without, -1, names).mean()), "unit": "%"},
    }
    for key, value in values.items():
        print(f"{key}: {value['value']:.3g}")
    if figure is not None:
        draw(cells, figure)
    measured.write(file, values, tables)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="The atlas of missing effects, from a cube of missing_effects.toml")
    parser.add_argument("cube", type=Path)
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the atlas")
    measured.add_option(parser)
    given = parser.parse_args()
    main(given.cube, given.figure, given.json)
