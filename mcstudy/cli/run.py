"""``mcstudy run``: run a study file into a results cube, or resume it."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("study", type=Path, help="study file (TOML)")
    parser.add_argument("-o", "--out", type=Path, help="results cube; default results/NAME.zarr")
    parser.add_argument("--workers", type=_positive, help="threads of the local scheduler; default one a core")
    parser.add_argument("--block", type=_positive, help="chunks a task; default about half a second of work")
    parser.add_argument(
        "--scheduler", metavar="ADDR", help="running Dask scheduler, tls://HOST:PORT or tcp://HOST:PORT"
    )
    parser.add_argument("--tls-ca", type=Path, metavar="PEM", help="certificate authority of a tls:// scheduler")
    parser.add_argument("--tls-cert", type=Path, metavar="PEM", help="client certificate for a tls:// scheduler")
    parser.add_argument("--tls-key", type=Path, metavar="PEM", help="key of the client certificate")
    parser.add_argument(
        "--insecure",
        action="store_true",
        help="accept a tcp:// scheduler on another machine",
    )
    parser.add_argument("--dashboard", action="store_true", help="serve Dask's dashboard on 127.0.0.1:8787")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1, got {text}")
    return value


def main(args: argparse.Namespace) -> int:
    """Run; returns the exit code."""
    from mcstudy.study.study_file import read_study

    study = read_study(args.study)
    # Dask is slow to import, and a bad study file should be told at once.
    from mcstudy.cli import DONE, FITS_FAILED
    from mcstudy.study.cluster import ClusterOptions
    from mcstudy.study.run import default_out, run_study

    options = ClusterOptions(
        workers=args.workers,
        scheduler=args.scheduler,
        dashboard=args.dashboard,
        insecure=args.insecure,
        tls_ca=args.tls_ca,
        tls_cert=args.tls_cert,
        tls_key=args.tls_key,
    )
    out = args.out or default_out(study)
    outcome = run_study(study, out, options, args.block)
    rate = f", {outcome.fits / outcome.seconds:.0f} fits/s" if outcome.seconds > 0 and outcome.fits else ""
    print(f"{out}: {outcome.fits} fits in {outcome.seconds:.1f} s{rate}; {outcome.skipped} were there already")
    for line in outcome.failed_blocks:
        print(f"failed block: {line}")
    if outcome.failed_blocks or outcome.failed_fits:
        from mcstudy.study.failures import failed_fits
        from mcstudy.study.store import Cube

        for line in failed_fits(Cube.open(out)):
            print(f"failed fit: {line}")
        return FITS_FAILED
    return DONE
