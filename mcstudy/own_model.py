"""A study of a model in memory, without a study file and without a cube."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import xarray as xr

from mcstudy.analysis.results import open_results
from mcstudy.stance.feedback import Model
from mcstudy.study.design import Study
from mcstudy.study.run import run_study


def run_model(model: Model, *, seed: int = 0, allow_unstable: bool = False, **fields: Any) -> xr.Dataset:
    """Simulate and fit a model, as one group of a study.

    Parameters
    ----------
    model
        Simulated as the subject and fitted to the data; it holds its own true values and bounds.
    seed
        Random seed.
    allow_unstable
        Accept true parameters whose closed loop is unstable.
    **fields
        Those of `Study.group`: ``realizations``, ``starts``, ``fmax`` (Hz), ``amplitude`` (in the unit of the model's
        stimulus), ``simulator``, and the tables ``stimulus``, ``noise``, ``spectra``, ``fit`` as dicts.

    Returns
    -------
    xarray.Dataset
        The group of the cube, in memory, with its statistics as ``.mc``.

    Raises
    ------
    DesignError
        The same mistakes as in a study file; one line that starts with the field.
    """
    study = Study.from_python("model", seed=seed).group("model", **fields, model=model)
    with TemporaryDirectory() as folder:
        run_study(study, Path(folder) / "model.zarr", allow_unstable=allow_unstable)
        return open_results(Path(folder) / "model.zarr", lazy=False)["model"].to_dataset()
