"""Pythons of this machine."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def newest_python() -> str:
    """The newest Python on this machine: this one, unless another is newer."""
    found = {sys.version_info[:3]: sys.executable}
    installed = (Path.home() / ".pyenv" / "versions").glob("3.*/bin/python")
    for program in [*map(str, installed), *(f"python3.{minor}" for minor in range(sys.version_info.minor + 1, 20))]:
        try:  # a name may be that of a program that only says it is not there
            call = [program, "-c", "import sys, venv, ensurepip; print(*sys.version_info[:3])"]
            said = subprocess.run(call, capture_output=True, text=True, check=True).stdout
        except (OSError, subprocess.CalledProcessError):
            continue
        found.setdefault(tuple(map(int, said.split())), program)  # type: ignore[arg-type]
    newest = max(found)
    return found[newest] if newest[:2] > sys.version_info[:2] else sys.executable
