"""Convert stored results to a form that NetCDF and MATLAB files can hold.

On disk, text has variable length and some attributes are JSON objects; neither NetCDF nor MATLAB files support that. In
memory, text has a fixed width and such an attribute is JSON text, which `structured` reads again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

PARAMETER_UNIT = "parameter_unit"
"""Coordinate with the unit of every parameter; results that have the dimension ``parameter`` keep it."""


def readable(data: xr.Dataset) -> xr.Dataset:
    """A group with text of fixed width, attributes of text and numbers, and the parameters' units as a coordinate."""
    text = {name: (v.dims, fixed_width(v.values), v.attrs) for name, v in data.variables.items() if v.dtype.kind == "T"}
    coordinates = [name for name in data.coords if name in text]
    out = data.assign_coords({name: text[name] for name in coordinates})
    out = out.assign({name: value for name, value in text.items() if name not in coordinates})
    if PARAMETER_UNIT in out.data_vars:
        out = out.set_coords(PARAMETER_UNIT)
    out.attrs = text_attributes(data.attrs)
    return out


def fixed_width(text: np.ndarray) -> np.ndarray:
    """Text as NumPy's own fixed-width type."""
    return np.asarray(text, dtype=object).astype(str)


def text_attributes(attributes: Mapping[Any, Any]) -> dict[Any, Any]:
    """Attributes with every object as its JSON text."""
    return {k: json.dumps(v, ensure_ascii=False) if isinstance(v, dict) else v for k, v in attributes.items()}


def structured(attributes: Mapping[Any, Any], name: str) -> Any:
    """The object that attribute ``name`` holds, stored as such or as JSON text; None when it is absent or neither."""
    value = attributes.get(name)
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except ValueError:
        return None
