"""Rows of `mcstudy show` that follow from the model and its noise alone: what a configuration misses of them."""

from __future__ import annotations

import numpy as np

from mcstudy.analysis.publications.verdict import judge
from mcstudy.analysis.publications.verdict_names import DIFFERS, LIMIT
from mcstudy.stance.noise import SensorNoise
from mcstudy.study.experiment import Experiment
from mcstudy.study.models import build_model
from mcstudy_goodworth2018.lost_table.simulate import CYCLE_S, CYCLES, PARAMETERS, PSD, RATE_HZ, study_of
from mcstudy_goodworth2018.paper.model_rows import sensitivity_values, sway_values
from mcstudy_goodworth2018.paper.statements import RESULTS


def misses(values: np.ndarray) -> np.ndarray:
    """Number of these rows that differ, or are further than `LIMIT` errors away, at ``values`` (N, U): (N,)."""
    return np.array([_misses(x) for x in values])


def _misses(values: np.ndarray) -> int:
    group = study_of(values, 0, 1).groups["accuracy"]
    noise = float(values[len(PARAMETERS)])
    sensor = SensorNoise((noise * PSD[0], noise * PSD[1]))
    model = build_model(group)
    found = sensitivity_values(model, Experiment(group, 0).f)
    found |= sway_values(model, sensor, CYCLE_S * CYCLES, CYCLES, RATE_HZ)
    verdicts = [judge(RESULTS[key], value) for key, value in found.items()]
    return sum(v.name == DIFFERS or abs(v.distance) > LIMIT for v in verdicts)
