"""The tests' own process has the thread settings of the command, which are noted in every cube.

Without this the first test that calls ``main`` would set them, and cubes made before and after it would differ.
"""

from __future__ import annotations

import os

from mcstudy.cli import ONE_THREAD

for variable in ONE_THREAD:
    os.environ.setdefault(variable, "1")
