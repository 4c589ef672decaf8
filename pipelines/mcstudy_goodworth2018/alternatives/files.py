"""Results of alternatives to the paper's method, as files that the report of a study can show.

The examples that make them are ``pipelines/examples/two_stimuli.py`` and ``population.py``; the file follows
``results_schema/1.0.0/alternative.json``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.files import schema
from mcstudy.files.json_files import read_json, write_json

SCHEMA = "alternative"


@dataclass(frozen=True)
class TwoStimuliResult:
    """Controllers identified without a model of them, from two stimuli and from one.

    Attributes
    ----------
    command: the command that made it. settings: its settings. f: (N,) Hz.
    estimators: name -> (stimuli in an experiment, controller -> "off", "chance", "single" (N,) in percent).
    """

    command: str
    settings: dict[str, Any]
    f: np.ndarray
    estimators: dict[str, tuple[int, dict[str, dict[str, np.ndarray]]]]


@dataclass(frozen=True)
class PopulationResult:
    """Mean of individual fits and fit to the mean, ``rows`` as in the schema, in percent of the truth."""

    command: str
    settings: dict[str, Any]
    rows: list[dict[str, Any]]


def write_alternative(path: Path, result: Mapping[str, Any]) -> None:
    """Write a result without its ``schema``; raises `StoreError` when it does not conform or cannot be written."""
    write_json(path, {"schema": schema.identifier(SCHEMA), **result}, SCHEMA)


def read_alternative(path: Path) -> TwoStimuliResult | PopulationResult:
    """Read what `write_alternative` wrote; raises `StoreError`, one line with file and place."""
    content = read_json(path, SCHEMA)
    command, settings = content["command"], content["settings"]
    if content["kind"] == "population":
        return PopulationResult(command, settings, content["rows"])
    f = np.array(content["frequency"], dtype=float)
    estimators = {}
    for e in content["estimators"]:
        controllers = {
            name: {k: np.array(values[k], dtype=float) for k in ("off", "chance", "single")}
            for name, values in e["controllers"].items()
        }
        for name, values in controllers.items():
            for k, v in values.items():
                if v.shape != f.shape:
                    raise StoreError(
                        f"{path}: {e['name']}: {name}: {k}: expected {f.size} numbers, one per frequency, got {v.size}"
                    )
        estimators[e["name"]] = int(e["stimuli"]), controllers
    return TwoStimuliResult(command, settings, f, estimators)
