"""A Monte Carlo study of a model declared in Python, without a study file.

A study file names one of the registered models. Here, any declared model (`mcstudy.stance.feedback.Model`) is studied
with the same random streams, data, fits and arrays. The result is a Dataset in memory, which every function of
`mcstudy.analysis` reads like a group of a cube.
"""

from __future__ import annotations

from typing import Any

import xarray as xr
from pydantic import TypeAdapter

import mcstudy.analysis.registration  # noqa: F401 - the result has its .mc methods
from mcstudy.files.plain_errors import validated
from mcstudy.scheduler.compiling import compile_kernels
from mcstudy.stance.feedback import Model
from mcstudy.study.checks import check_group
from mcstudy.study.cube.conversion import readable
from mcstudy.study.cube.layout import Chunk
from mcstudy.study.design import Group
from mcstudy.study.execution.tasks import fill
from mcstudy.study.experiment import Experiment
from mcstudy.study.instability import refuse_unstable_model
from mcstudy.study.kernels import parts_of


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
    """Simulate and fit a model, as for one group of a study file.

    Parameters
    ----------
    model
        Simulated as the subject and fitted to the data; it holds its own true values and bounds.
    realizations
        Noise realizations.
    starts
        Fits per realization, Fmax and amplitude.
    fmax
        Highest frequencies of the fits, Hz.
    amplitude
        Stimulus amplitudes, in the unit of the model's stimulus.
    seed
        Random seed.
    allow_unstable
        Accept true parameters whose closed loop is unstable.
    **sections
        The tables ``stimulus``, ``noise``, ``spectra``, ``fit`` of a study file, as dicts, and ``simulator``.

    Returns
    -------
    xarray.Dataset
        Variables, dimensions, units and attributes of a group of a cube (``results_schema/README.md``), with its
        statistics as ``.mc``. The model names the coordinates of ``angle``. Attribute ``declared_model`` holds the
        model as JSON; the section ``model`` of the design does not apply to it.

    Raises
    ------
    DesignError
        The same mistakes as in a study file; one line that starts with the field.
    """
    axes = {"realizations": realizations, "starts": starts, "fmax": fmax, "amplitude": amplitude}
    group: Group = validated(Group, {**axes, **sections}, whole="settings")
    check_group(group, model)
    compile_kernels(parts_of([group]))
    refuse_unstable_model(model, group.simulator, allow_unstable)
    experiment = Experiment(group, seed, model)
    cells = experiment.layout(group.realizations)
    arrays = cells.arrays
    parts = []
    for position in range(len(group.amplitude)):
        chunk = Chunk(position, 0)
        data = cells.empty(chunk)
        fill(experiment, cells, chunk, data)
        parts.append(xr.Dataset({name: (arrays[name].dims, data[name]) for name in cells.results}))
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
