"""A bias study of a model declared in Python, without a study file.

A study file names one of the registered models. A model that someone declares themselves
(`mcstudy.stance.feedback.Model`) goes through the same machinery here - same streams, same data, same fits, same
arrays - and comes back as a Dataset in memory that every function of `mcstudy.analysis` reads like a group of a cube.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import xarray as xr
from pydantic import TypeAdapter

import mcstudy.accessors  # noqa: F401 - the result has its .mc methods
from mcstudy.stance.feedback import Model
from mcstudy.study.checks import check
from mcstudy.study.design import Group
from mcstudy.study.experiment import Experiment
from mcstudy.study.layout import Chunk
from mcstudy.study.plain_errors import validated
from mcstudy.study.readable import readable
from mcstudy.study.store import GroupStore
from mcstudy.study.tasks import fill
from mcstudy.study.unstable import refuse_unstable_model


def run_model(
    model: Model,
    *,
    realizations: int,
    starts: int,
    fmax: tuple[float, ...],
    amplitude: tuple[float, ...],
    seed: int = 0,
    allow_unstable: bool = False,
    **sections: dict[str, Any],
) -> xr.Dataset:
    """Measure, fit and describe a model as one group of a study file would.

    Parameters
    ----------
    model: the subject and the model fitted to it; truth and bounds are its own.
    realizations, starts, fmax (Hz), amplitude (units of the model's stimulus): as in ``[group.NAME]``.
    seed: as in ``[study]``.
    allow_unstable: whether the closed loop of the model's true parameters may be unstable.
    sections: the tables ``stimulus``, ``noise``, ``spectra``, ``fit`` of a study file, as dicts, and ``simulator``.

    Returns
    -------
    Dataset with the variables, dims, units and attributes of a group of a cube (results_schema/README.md), ``angle``
    named by the model. Attribute ``declared_model`` is the model itself as JSON, so that `mcstudy.analysis` knows it;
    the section ``model`` of the design does not speak of it.

    Raises
    ------
    DesignError: for what a study file would be refused for; one line that starts with the field.
    """
    axes = {"realizations": realizations, "starts": starts, "fmax": fmax, "amplitude": amplitude}
    group: Group = validated(Group, {**axes, **sections}, whole="settings")
    check(group, model)
    refuse_unstable_model(model, group.simulator, allow_unstable)
    experiment = Experiment(group, seed, model)
    # Only for its layout: nothing of a store touches the disk before it is written to.
    store = GroupStore(Path(), model.name, experiment, group.realizations, "")
    arrays = store.layout.arrays
    parts = []
    for position in range(len(group.amplitude)):
        chunk = Chunk(position, 0)
        data = store.layout.empty(chunk)
        fill(store, chunk, data, stopped=lambda: False)
        parts.append(xr.Dataset({name: (arrays[name].dims, data[name]) for name in store.layout.results}))
    out = xr.concat(parts, dim="amplitude")
    for name, spec in arrays.items():
        if spec.values is not None:
            out[name] = (spec.dims, spec.values.astype(str if spec.dtype == "string" else spec.dtype))
        out[name].attrs = dict(spec.attributes)
    out.attrs = {
        "design": group.model_dump(mode="json"),
        "declared_model": TypeAdapter(Model).dump_python(model, mode="json"),
        "model": model.name,
        "truth_provenance": model.provenance,
        "stimulus_unit": model.stimulus_unit,
        "seed": seed,
    }
    angles = {dim: list(model.angles) for dim in ("angle", "angle_2") if dim in out.dims}
    return readable(out.assign_coords({dim: (dim, names, arrays[dim].attributes) for dim, names in angles.items()}))
