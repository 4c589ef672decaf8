"""Every quality gate, in the order in which they fail fastest: ``python -m tests``.

Lint and format, and beside them the kernels are compiled; then the tests (which also run the shipped examples), and
beside them types are checked: a fault there ends the tests. ``--quick``, for the inner loop, leaves out tests that take
long (`tests/durations.txt`). Other arguments go to pytest.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHON = (sys.executable, "-m")
WORKERS = (os.cpu_count() or 1) + 1
"""One more than there are cores: some tests wait for other processes, or for time to pass."""
LINT: tuple[tuple[str, ...], ...] = (("ruff", "check", "."), ("ruff", "format", "--check", "."))
TYPES = ("mypy",)
TESTS = ("pytest", "-n", str(WORKERS), "-q")


def main(arguments: list[str]) -> int:
    """Run the gates one after the other; the status of the first that fails."""
    missing = [gate[0] for gate in (*LINT, TYPES, TESTS) if find_spec(gate[0]) is None]
    if missing:
        print(
            f"tests: {', '.join(dict.fromkeys(missing))} not installed; pip install -c .ci/constraints.txt -e '.[dev]'"
        )
        return 2
    # The tests start hundreds of processes, which load bytecode; pip has compiled that of the packages.
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX")}
    run = partial(subprocess.Popen, cwd=ROOT, env=environment)

    def begun(gate: tuple[str, ...]) -> subprocess.Popen[bytes]:
        print(f"== {' '.join(gate)}", flush=True)
        return run([*PYTHON, *gate])

    with run([*PYTHON, "mcstudy", "warm"], stdout=subprocess.DEVNULL) as compiling:
        for gate in LINT:
            if status := begun(gate).wait():
                compiling.terminate()
                return status
        with begun(TYPES) as types:
            compiling.wait()  # else every worker would compile the same functions
            with begun((*TESTS, *arguments)) as tests:
                if status := types.wait():
                    tests.terminate()
                return status or tests.wait()


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
