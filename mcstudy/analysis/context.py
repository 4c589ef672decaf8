"""The design and the model of a group of a cube, rebuilt from its attributes."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr
from pydantic import ValidationError

from mcstudy.analysis.efficiency import measured_covariance
from mcstudy.errors import StoreError
from mcstudy.spectra.bands import Bands
from mcstudy.stance.feedback import Model
from mcstudy.stance.information import expected_line_covariance
from mcstudy.stance.joint import members
from mcstudy.study.cube.conversion import structured
from mcstudy.study.design import Group
from mcstudy.study.measure import kept_points, stimulus
from mcstudy.study.models import build_model, simulated_model

DESIGN = "design"
"""Attribute of a group that holds its resolved design."""


def group_of(data: xr.Dataset) -> Group:
    """Design of the group that ``data`` came from; raises `StoreError` when the attribute is absent or not valid."""
    if DESIGN not in data.attrs:
        raise StoreError(f"attribute {DESIGN!r}: expected the design of the group, found none")
    try:
        return Group.model_validate_json(json.dumps(structured(data.attrs, DESIGN)))
    except (ValidationError, TypeError) as error:
        why = str(error).splitlines()[0]
        raise StoreError(f"attribute {DESIGN!r}: expected the design of a group, got {why}") from None


def model_of(data: xr.Dataset) -> Model:
    """Model of the group with its truth and bounds; raises `StoreError` when it has other parameters than the data."""
    model = fitted_model(data)
    if list(model.names) != [str(n) for n in data["parameter"].values]:
        raise StoreError(f"parameter: expected {', '.join(model.names)} as in the design")
    return model


def fitted_model(data: xr.Dataset) -> Model:
    """The same for data with any parameters; cells of `mcstudy.analysis.selection.combined` have sums of parameters."""
    return build_model(group_of(data))


def points_of(data: xr.Dataset) -> Bands:
    """Frequency points of the group."""
    return kept_points(group_of(data))


def provenance_of(data: xr.Dataset) -> str:
    """Origin of the true values; it must be shown wherever they are shown.

    It follows from the design: cubes of older programs call a user's own body the paper's.
    """
    try:
        text = fitted_model(data).provenance
    except StoreError:  # no design
        text = ""
    return text or str(data.attrs.get("truth_provenance", ""))


def covariance_of(data: xr.Dataset) -> xr.DataArray:
    """Best available covariance of the FRF errors at every point, dims (amplitude, frequency, angle, angle_2).

    For single lines without the leakage ramp it is the theoretical covariance; for band means and lines with leakage it
    is the mean of the stored estimates. The attribute ``source`` says which. Raises `InputError` without noise.
    """
    group = group_of(data)
    if group.simulator == "none" or group.spectra.points != "odd_lines" or group.spectra.ramp != "remove":
        return measured_covariance(data).assign_attrs(source="mean of the stored noise covariances")
    model, points, s = simulated_model(group), points_of(data), group.stimulus
    duration_s = (s.cycles - s.discard) * points.period_s
    under = members(model)
    covariance = np.zeros(
        (len(group.amplitude), len(data["frequency"]), model.n_outputs, model.n_outputs), dtype=complex
    )
    noise, measured = group.noise_source, group.measurement_noise
    recorded = None if measured is None else measured.psd_without_ramp(points.f, duration_s, s.rate_hz)
    for a, amplitude in enumerate(group.amplitude):
        drive = stimulus(group, amplitude).coefficients()[points.lines]
        of_one = expected_line_covariance(under[0], model.truth, noise, points.f, drive, duration_s, recorded)
        covariance[a] = np.repeat(of_one, len(under), axis=0)
    coords = {d: data[d] for d in ("amplitude", "frequency")}
    dims = ("amplitude", "frequency", "angle", "angle_2")
    return xr.DataArray(covariance, coords, dims, attrs={"source": "sensor noise through the true loop"})


def nearest(values: np.ndarray, wanted: float, tolerance: float = 0.011) -> float | None:
    """The coordinate value within ``tolerance`` (relative, plus rounding) of ``wanted``, or None."""
    values = np.asarray(values, dtype=float)
    if values.size == 0:
        return None
    close = float(values[np.argmin(np.abs(values - wanted))])
    return close if abs(close - wanted) <= tolerance * abs(wanted) else None
