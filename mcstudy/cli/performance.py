"""``mcstudy performance``: bias, errors and coverage of estimates that any program made."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    import xarray as xr

PERCENT = ("coverage", "bias_eliminated_coverage")
"""Measures that are fractions and are printed in percent with their interval."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument(
        "table",
        type=Path,
        help="CSV file with the columns parameter, realization, estimate, truth, and where they exist standard_error "
        "and method: one row per realization, parameter and method",
    )
    parser.add_argument(
        "--reference", metavar="METHOD", help="method that relative_precision refers to (default: the first)"
    )
    parser.add_argument(
        "--level", type=float, default=0.95, help="level of the intervals whose coverage is counted (default 0.95)"
    )
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="also write every number as a CSV file")


def main(args: argparse.Namespace) -> Exit:
    """Print the table; returns the exit code."""
    from mcstudy.api.performance import performance

    found = performance(args.table, reference=args.reference, level=args.level)
    print(_text(found))
    if args.out is not None:
        from mcstudy.files.json_files import write_text

        write_text(args.out, found.to_dataframe().reset_index().to_csv(index=False))
    return Exit.DONE


def _text(found: xr.Dataset) -> str:
    """One row per method and parameter, one column per measure, and what the measures are."""
    from mcstudy.text_tables import fill, table

    measures = [str(m) for m in found["measure"].values]
    methods = [str(m) for m in found["method"].values] if "method" in found.dims else [None]
    header = [*(["method"] if methods[0] else []), "parameter", "n", *measures]
    rows = []
    for method in methods:
        own = found if method is None else found.sel({"method": method})
        for name in map(str, own["parameter"].values):
            one = own.sel(parameter=name)
            cells = [_cell(one.sel(measure=m), m) for m in measures]
            rows.append([*([method] if method else []), name, str(int(one["n"].sel(measure="bias"))), *cells])
    told = [
        f"{m}: {meaning} ({unit})."
        for m, meaning, unit in zip(measures, found["meaning"].values, found["measure_unit"].values, strict=True)
    ]
    after = "Numbers are ± one Monte Carlo standard error; fractions have Wilson's 95 % interval. n: estimates."
    return "\n".join([table(header, rows), "", *(fill(line, "  ") for line in told), fill(after)])


def _cell(one: xr.Dataset, measure: str) -> str:
    from mcstudy.text_tables import with_error

    numbers = {k: float(one[k]) for k in ("value", "mcse", "lower", "upper")}
    if measure in PERCENT and numbers["value"] == numbers["value"]:
        return "{value:.1f} % [{lower:.1f}, {upper:.1f}]".format(**{k: 100 * v for k, v in numbers.items()})
    value, mcse = (numbers[k] if numbers[k] == numbers[k] else None for k in ("value", "mcse"))
    return with_error(value, mcse)
