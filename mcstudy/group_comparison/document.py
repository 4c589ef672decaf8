"""A comparison of two groups as a JSON document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from mcstudy.files.schema import identifier
from mcstudy.group_comparison.result import ComparisonRecord
from mcstudy.group_comparison.verdict import verdict


def document(c: ComparisonRecord) -> dict[str, Any]:
    """All results as plain JSON data, valid under ``results_schema/1.0.0/comparison.json``."""
    return {
        "schema": identifier("comparison"),
        "a": c.a,
        "b": c.b,
        "people": list(c.people),
        "paired": c.paired,
        "stimulus": c.stimulus,
        "permutations": c.permutations,
        "inflation": c.inflation,
        "verdict": verdict(c),
        "notes": list(c.notes),
        "kind": c.kind,
        "frequency": c.f.tolist(),
        "mean_a": _complex(c.mean_a),
        "mean_b": _complex(c.mean_b),
        "error_a": c.error_a.tolist(),
        "error_b": c.error_b.tolist(),
        "predicted_difference": None if c.predicted is None else _complex(c.predicted),
        "detection": {**asdict(c.detection), "regions": [asdict(region) for region in c.detection.regions]},
        "causes": [
            {
                **asdict(cause),
                "parameters": [{"name": name, "a": a, "b": b} for name, a, b in cause.parameters],
            }
            for cause in c.causes
        ],
    }


def _complex(response: np.ndarray) -> dict[str, Any]:
    return {"real": response.real.tolist(), "imaginary": response.imag.tolist()}
