"""Every quality gate, in the order in which they fail fastest: ``python -m tests``.

Lint, format and type checks, then the tests (which also run the shipped examples). Extra arguments go to pytest.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHON = (sys.executable, "-m")
GATES: tuple[tuple[str, ...], ...] = (
    ("ruff", "check", "."),
    ("ruff", "format", "--check", "."),
    ("mypy",),
    ("pytest", "-n", "auto", "-q"),
)


def main(arguments: list[str]) -> int:
    """Run the gates one after the other; the status of the first that fails."""
    # Bytecode goes beside the packages, not into the tree: the tests start hundreds of processes.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(Path(sys.prefix) / "bytecode")
    for gate in GATES:
        extra = arguments if gate[0] == "pytest" else []
        command = [*PYTHON, *gate, *extra]
        print(f"== {' '.join(gate)}", flush=True)
        status = subprocess.run(command, cwd=ROOT, env=environment).returncode
        if status:
            return status
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
