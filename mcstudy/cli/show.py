"""``mcstudy show``: print the tables of a results cube."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")
    parser.add_argument("--json", action="store_true", help="machine-readable, as results_schema describes")


def main(args: argparse.Namespace) -> int:
    """Print; returns the exit code."""
    from mcstudy.analysis.tables import show
    from mcstudy.cli import DONE

    report = show(args.out)
    print(report.json() if args.json else report.text())
    return DONE
