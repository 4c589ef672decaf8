"""A module of this package run as a process of its own, which is spoken to through pipes."""

from __future__ import annotations

import os
import subprocess
import sys


def start(module: str, **variables: str) -> subprocess.Popen[bytes]:
    """``python -m module`` with the modules that this process finds, and further environment ``variables``.

    It has a session of its own, so that Ctrl-C does not reach it, and nothing reads what it says on stderr. Raises
    ``OSError`` or ``ValueError`` when no Python can be started.
    """
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **variables},
        start_new_session=True,
    )
