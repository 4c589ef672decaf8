"""``mcstudy run``: run a study file into a results cube, or resume it."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.cli.options import add_cluster_arguments, cluster_options, tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("study", type=Path, help="study file (TOML)")
    parser.add_argument("-o", "--out", type=Path, help="results cube; default results/NAME.zarr")
    add_cluster_arguments(parser)


def main(args: argparse.Namespace) -> int:
    """Run; returns the exit code."""
    from mcstudy.study.study_file import read_study

    study = read_study(args.study)
    # Dask is slow to import, and a bad study file should be told at once.
    from mcstudy.study.run import default_out, run_study

    out = args.out or default_out(study)
    return tell(run_study(study, out, cluster_options(args), args.block), out)
