"""``mcstudy performance``: bias, errors and coverage of estimates that any program made."""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    import xarray as xr

    from mcstudy.cli.parser import Parser

TOPIC = "statistics"


PERCENT = ("coverage", "bias_eliminated_coverage")
"""Measures that are fractions and are printed in percent with their interval."""


LONGEST_NAME = 60
"""Characters of a name that are printed."""


def add_arguments(parser: Parser) -> None:
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
    if args.out is not None:
        from mcstudy.files.csv_text import csv_text
        from mcstudy.files.json_files import write_text

        rows = found.to_dataframe().reset_index()
        write_text(args.out, csv_text(list(rows.columns), rows.itertuples(index=False)))
    print(_text(found))
    return Exit.DONE


def _text(found: xr.Dataset) -> str:
    """One row per method and parameter, one column per measure, and what the measures are."""
    from mcstudy.text_tables import fill, printable, table

    measures = [str(m) for m in found["measure"].values]
    several = "estimator" in found.dims
    errors = found.sel(measure="model_se")["n"] if "model_se" in measures else found["n"].isel(measure=0)
    incomplete = bool((errors != found["n"].sel(measure="bias")).any())
    header = [*(["method"] if several else []), "parameter", "n", *(["n of SE"] if incomplete else []), *measures]
    rows = []
    for one in _cells_of(found, ("estimator", "parameter") if several else ("parameter",)):
        names = [
            printable(str(one[d].item()), LONGEST_NAME) for d in (["estimator"] if several else []) + ["parameter"]
        ]
        counts = [str(int(one["n"].sel(measure=m))) for m in ("bias", *(["model_se"] if incomplete else []))]
        rows.append([*names, *counts, *(_cell(one.sel(measure=m), m) for m in measures)])
    told = [
        f"{m}: {meaning} ({unit})."
        for m, meaning, unit in zip(measures, found["meaning"].values, found["measure_unit"].values, strict=True)
    ]
    after = "Numbers are ± one Monte Carlo standard error; fractions have Wilson's 95 % interval. n: estimates."
    if incomplete:
        after += " n of SE: estimates with a standard error; the measures of standard errors are over these."
    return "\n".join([table(header, rows), "", *(fill(line, "  ") for line in told), fill(after)])


def _cells_of(found: xr.Dataset, dims: Sequence[str]) -> Iterator[xr.Dataset]:
    """One dataset for every combination of positions of ``dims``, the first outermost."""
    for positions in itertools.product(*(range(found.sizes[d]) for d in dims)):
        yield found.isel(dict(zip(dims, positions, strict=True)))


def _cell(one: xr.Dataset, measure: str) -> str:
    from mcstudy.text_tables import with_error

    numbers = {k: float(one[k]) for k in ("value", "mcse", "lower", "upper")}
    if measure in PERCENT and numbers["value"] == numbers["value"]:
        return "{value:.1f} % [{lower:.1f}, {upper:.1f}]".format(**{k: 100 * v for k, v in numbers.items()})
    value, mcse = (numbers[k] if numbers[k] == numbers[k] else None for k in ("value", "mcse"))
    return with_error(value, mcse)
