"""Cubes made to order: the statistics are tested where the answer is known, not on fits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

import mcstudy.analysis.registration  # noqa: F401 - made cubes have their .mc methods in every test
from mcstudy.fitting.status import Status
from mcstudy.stance.response import frf
from mcstudy.study.design import Group
from mcstudy.study.experiment import kept_points
from mcstudy.study.models import build_model


def cube_of(group: Group, rng: np.random.Generator, spread: float = 0.1, hit_rate: float = 0.5) -> xr.Dataset:
    """A cube of ``group`` as the store lays it out, with invented fits.

    Each realization's global minimum is truth * (1 + spread * normal), at cost 0.01 * (1 + 0.1 * realization), reached
    by a fraction ``hit_rate`` of the starts (at least one); the other starts end in one local minimum of twice the
    cost, an unstable one. FRFs scatter by ``spread`` of their magnitude.
    """
    model, bands = build_model(group), kept_points(group)
    A, F, R, S, P = len(group.amplitude), len(group.fmax), group.realizations, group.starts, len(model.parameters)
    noise = rng.standard_normal((A, F, R, 1, P))
    hit = rng.random((A, F, R, S)) < hit_rate
    hit[..., 0] |= ~hit.any(-1)
    good = model.truth * (1 + spread * noise)
    estimate = np.where(hit[..., None], good, model.truth * 1.5)
    base = 0.01 * (1 + 0.1 * np.arange(R))[:, None]
    cell, per = (
        ("amplitude", "fmax", "realization", "start"),
        ("amplitude", "fmax", "realization", "start", "parameter"),
    )
    N, Y = len(bands), model.n_outputs
    covariance = np.broadcast_to(1e-12 * np.eye(Y, dtype=complex), (A, R, N, Y, Y)).copy()
    data: dict[str, Any] = {
        "estimate": (per, estimate),
        "initial": (per, rng.uniform(model.lower, model.upper, (A, F, R, S, P))),
        "cost": (cell, np.where(hit, base, 2 * base)),
        "status": (cell, np.full((A, F, R, S), int(Status.CONVERGED), dtype=np.uint8)),
        "iterations": (cell, np.full((A, F, R, S), 20, dtype=np.int32)),
        "at_bound": (per, np.zeros((A, F, R, S, P), dtype=np.int8)),
        "growth_rate": (cell, np.where(hit, -1.0, 0.5)),
        "truth": ("parameter", model.truth),
        "lower": ("parameter", model.lower),
        "upper": ("parameter", model.upper),
        "n_frequencies": ("fmax", [len(bands.below(f)) for f in group.fmax]),
        "true_frf": (("frequency", "angle"), frf(model, model.truth, bands.f)),
    }
    ideal, size = data["true_frf"][1], (A, R, N, Y)
    scatter = spread * (rng.standard_normal(size) + 1j * rng.standard_normal(size)) / np.sqrt(2)
    data["frf"] = (("amplitude", "realization", "frequency", "angle"), ideal * (1 + scatter))
    if group.simulator != "none":
        data["noise_covariance"] = (("amplitude", "realization", "frequency", "angle", "angle_2"), covariance)
    return xr.Dataset(
        data,
        coords={
            "amplitude": list(group.amplitude),
            "fmax": list(group.fmax),
            "realization": np.arange(R),
            "start": np.arange(S),
            "parameter": list(model.names),
            "angle": list(model.output_names),
            "angle_2": list(model.output_names),
            "frequency": bands.f,
        },
        attrs={
            "design": group.model_dump(mode="json"),
            "model": model.name,
            "truth_provenance": model.provenance,
            "stimulus_unit": model.stimulus_unit,
        },
    )


@pytest.fixture(scope="session")
def make_group() -> Callable[..., Group]:
    """A group of a study; the paper's Fmax and amplitudes unless told otherwise."""

    def make(realizations: int = 6, starts: int = 5, **changes: Any) -> Group:
        settings: dict[str, Any] = {"fmax": (0.41, 1.2, 8.0), "amplitude": (3.0, 5.0), **changes}
        return Group(realizations=realizations, starts=starts, **settings)

    return make


@pytest.fixture(scope="session")
def make_cube(make_group: Callable[..., Group]) -> Callable[..., xr.Dataset]:
    """An invented cube: ``make_cube(realizations=, starts=, spread=, hit_rate=, seed=, **group settings)``."""

    def make(spread: float = 0.1, hit_rate: float = 0.5, seed: int = 1, **settings: Any) -> xr.Dataset:
        return cube_of(make_group(**settings), np.random.default_rng(seed), spread, hit_rate)

    return make
