"""What a group of a cube says about itself: its design and its model, rebuilt from the attributes."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr
from pydantic import ValidationError

from mcstudy.errors import StoreError
from mcstudy.spectra.bands import Bands
from mcstudy.stance.feedback import Model
from mcstudy.study.design import Group
from mcstudy.study.experiment import kept_points
from mcstudy.study.models import build_model

DESIGN = "design"
"""Attribute of a group that holds its resolved design."""


def group_of(data: xr.Dataset) -> Group:
    """Design of the group that ``data`` came from; raises `StoreError` when the attribute is absent or not valid."""
    if DESIGN not in data.attrs:
        raise StoreError(f"attribute {DESIGN!r}: expected the design of the group, found none")
    try:
        return Group.model_validate_json(json.dumps(data.attrs[DESIGN]))
    except (ValidationError, TypeError) as error:
        why = str(error).splitlines()[0]
        raise StoreError(f"attribute {DESIGN!r}: expected the design of a group, got {why}") from None


def model_of(data: xr.Dataset) -> Model:
    """Model of the group, with the truth and bounds it was fitted with."""
    model = build_model(group_of(data))
    if list(model.names) != [str(n) for n in data["parameter"].values]:
        raise StoreError(f"parameter: expected {', '.join(model.names)} as in the design")
    return model


def points_of(data: xr.Dataset) -> Bands:
    """Frequency points of the group."""
    return kept_points(group_of(data))


def provenance_of(data: xr.Dataset) -> str:
    """Where the true values come from; to be shown wherever they are."""
    return str(data.attrs.get("truth_provenance") or build_model(group_of(data)).provenance)


def nearest(values: np.ndarray, wanted: float, tolerance: float = 0.011) -> float | None:
    """The coordinate value within ``tolerance`` (relative, plus rounding) of ``wanted``, or None."""
    values = np.asarray(values, dtype=float)
    if values.size == 0:
        return None
    close = float(values[np.argmin(np.abs(values - wanted))])
    return close if abs(close - wanted) <= tolerance * abs(wanted) else None
