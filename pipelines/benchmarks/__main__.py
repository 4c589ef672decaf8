"""``python -m pipelines.benchmarks [--only NAME ...] [--quick] [--json [FILE]] [--figures DIR]``.

Of single benchmarks ``--wheel FILE`` (wheel), ``--largest FITS`` and ``--folder DIR`` (scale).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmarks asked for; returns the exit code."""
    for name in ONE_THREAD:  # before anything imports NumPy; children inherit it
        os.environ[name] = "1"
    from pipelines import measured
    from pipelines.benchmarks.measure import machine
    from pipelines.benchmarks.report import QUICK, Sizes
    from pipelines.benchmarks.suite import BENCHMARKS

    parser = argparse.ArgumentParser(prog="python -m pipelines.benchmarks", description=__doc__)
    parser.add_argument("--only", action="append", choices=list(BENCHMARKS), metavar="NAME", help=", ".join(BENCHMARKS))
    parser.add_argument(
        "--quick", action="store_true", help="tiny sizes: a test that everything runs, not a measurement"
    )
    parser.add_argument(
        "--wheel",
        type=Path,
        metavar="FILE",
        help="a wheel built before, for the benchmark wheel; otherwise it builds one",
    )
    parser.add_argument(
        "--figures", type=Path, metavar="DIR", help="write figures of benchmarks that have one (needs matplotlib)"
    )
    parser.add_argument(
        "--json", nargs="?", const="-", metavar="FILE", help="write JSON to FILE, or print it instead of the tables"
    )
    parser.add_argument(
        "--measured", type=Path, metavar="DIR", help="write benchmarks_NAME.json to DIR, as the pages use them"
    )
    parser.add_argument(
        "--largest",
        type=lambda text: int(float(text)),
        metavar="FITS",
        help="scale: largest study; 1e8 takes 10 GB of disk and about an hour",
    )
    parser.add_argument(
        "--folder",
        type=Path,
        metavar="DIR",
        help="scale: keep cubes and measurements in DIR; a repeated call continues",
    )
    args = parser.parse_args(arguments)
    sizes = replace(QUICK if args.quick else Sizes(), wheel=args.wheel, folder=args.folder)
    if args.largest is not None:
        sizes = replace(sizes, scale=tuple(10**k for k in range(3 if args.quick else 5, 9) if 10**k <= args.largest))
    document: dict[str, object] = {"machine": machine(), "quick": args.quick}
    details = {}
    for name, run in BENCHMARKS.items():
        if args.only and name not in args.only:
            continue
        result = run(sizes)
        document.update(result.keys)
        details[name] = {"table": result.table, "notes": result.notes}
        print(result.text(), file=sys.stderr if args.json == "-" else sys.stdout, flush=True)
        if args.figures and result.figure is not None:
            args.figures.mkdir(parents=True, exist_ok=True)
            result.figure(args.figures / f"{name}.svg")
        document["details"] = details
        if args.measured:
            columns = list(dict.fromkeys(key for row in result.table for key in row))
            rows = [[_plain(row.get(key, "")) for key in columns] for row in result.table]
            values = {key.replace(".", "_"): {"value": _plain(value)} for key, value in result.keys.items()}
            measured.write(args.measured / f"benchmarks_{name}.json", values, {"table": (columns, rows)})
        if args.json not in (None, "-"):  # after each, since all of them take long
            Path(args.json).write_text(_json(document) + "\n")
    if args.json == "-":
        print(_json(document))
    return 0


def _json(document: dict[str, object]) -> str:
    """JSON text; numbers that are not finite (starts needed by a solver that never succeeded) become null."""
    return json.dumps(_plain(document), indent=1, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (str, bool, int)) or value is None:
        return value
    return float(value) if math.isfinite(value) else None


if __name__ == "__main__":
    raise SystemExit(main())
