"""Digests of three cubes, three fits and three diagnoses: ``python -m tests.digests``, before and after a refactoring.

Equal lines mean equal bits. They hold for one machine and one environment (processor, BLAS, NumPy): print them before
a change, print them after it, and compare.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import mcstudy as mc

ROOT = Path(__file__).parents[1]
STUDIES = ("quick", "one_segment", "solvers")
PEOPLE: tuple[dict[str, Any], ...] = (
    {"effects": {}, "cycles": 4, "rate_hz": 100.0},
    {"effects": {"sensor_lag_theta1": 0.02}, "cycles": 5, "rate_hz": 100.0},
    {"effects": {"passive_damping_ankle": 40.0}, "cycles": 6, "rate_hz": 100.0, "amplitude": [3.0, 5.0]},
)
"""What `mcstudy.simulate` is asked for."""


def _short(study: mc.Study) -> mc.Study:
    """The study with two realizations and at most five starts in every group."""
    groups = {
        name: group.model_copy(update={"realizations": 2, "starts": min(5, int(group.starts))})
        for name, group in study.groups.items()
    }
    return study.model_copy(update={"groups": groups})


def _of_cube(cube: Any) -> str:
    digest = hashlib.sha256()
    for node in cube.subtree:
        for name in sorted(node.variables):
            values = np.asarray(node[name].values)
            content = values.tobytes() if values.dtype.kind in "bifc" else "\n".join(map(str, values.flat)).encode()
            digest.update(f"{node.path} {name} {values.dtype} {values.shape}\n".encode() + content)
    return digest.hexdigest()


def _of_json(document: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def digests() -> Iterator[tuple[str, str]]:
    """What it is and its SHA-256, one after the other."""
    with tempfile.TemporaryDirectory() as folder:
        for name in STUDIES:
            study = _short(mc.read_study(ROOT / f"pipelines/{name}.toml"))
            yield f"cube {name}", _of_cube(mc.run(study, Path(folder) / f"{name}.zarr"))
    for seed, person in enumerate(PEOPLE, start=1):
        recording = mc.simulate(**person, seed=seed)
        effects = ", ".join(person["effects"]) or "no effect"
        yield f"fit {effects}", _of_json(mc.fit(recording, fmax=3.0, seed=1).to_dict())
        yield f"diagnosis {effects}", _of_json(mc.diagnose(recording, fast=True, seed=1).to_dict())


if __name__ == "__main__":
    for what, digest in digests():
        print(f"{digest[:32]}  {what}", flush=True)
