"""Empty cubes that `verify` and `repair` compare a cube with, each made once.

An empty cube follows from the study, the environment and the depths alone. Both make one in every call, which takes
longer than everything else that a test of one damaged file does.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mcstudy.study import verify
from mcstudy.study.cube import repair
from mcstudy.study.cube.store import Cube


@contextmanager
def made_once() -> Iterator[None]:
    """Within the block, an empty cube that was made before is used again."""
    honest, made = repair.skeleton, dict[str, dict[Path, bytes]]()

    def skeleton(cube: Cube, made_in: dict[str, Any], others: dict[str, Any]) -> dict[Path, bytes]:
        key = json.dumps([cube.study.fingerprint, made_in, others, cube.depths])
        if key not in made:
            made[key] = honest(cube, made_in, others)
        return dict(made[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verify, "skeleton", skeleton)
        patch.setattr(repair, "skeleton", skeleton)
        yield
