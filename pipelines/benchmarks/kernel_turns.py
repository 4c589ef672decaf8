"""A process that times the same fits whenever a line comes in; `benchmarks.wheel` runs two of them in turn."""

from __future__ import annotations

import sys

import numpy as np

import mcstudy
from mcstudy.fitting.solvers import fit
from mcstudy.fitting.starts import uniform
from pipelines.benchmarks.cases import cases
from pipelines.benchmarks.measure import timed


def main() -> None:
    """First a line with the file of the package and SHA-256 of the costs; then CPU seconds, a line per line read."""
    problems = [case.problem for case in cases(1, 8) if case.realization == 0]
    pools = [uniform(problem.model, np.random.default_rng(1), int(sys.argv[1])) for problem in problems]

    def fits() -> list[bytes]:
        return [fit(problem, pool).cost.tobytes() for problem, pool in zip(problems, pools, strict=True)]

    print(mcstudy.__file__, hash_of(fits()), flush=True)
    for _ in sys.stdin:
        print(timed(fits)[1], flush=True)


def hash_of(parts: list[bytes]) -> str:
    """SHA-256 of bytes."""
    from hashlib import sha256

    return sha256(b"".join(parts)).hexdigest()


if __name__ == "__main__":
    main()
