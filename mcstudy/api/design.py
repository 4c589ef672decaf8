"""Designing a stimulus from Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcstudy.files.local_path import local_path
from mcstudy.results.stimulus_design import StimulusDesign
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.feedback import Model
from mcstudy.stimulus_design.design_file import parse_design, read_design
from mcstudy.stimulus_design.run import design_stimulus
from mcstudy.study.study_file import with_model


def design(
    file: dict[str, Any] | str | Path,
    out: str | Path | None = None,
    *,
    model: Model | str | Path | None = None,
    verify: bool = True,
    workers: int | None = None,
    scheduler: str | None = None,
) -> StimulusDesign:
    """Design the periodic stimulus that identifies the parameters best, and verify it by Monte Carlo.

    Parameters
    ----------
    file
        Path of a design file, name of a shipped one (``design``), or its tables as a dict, e.g.
        ``{"design": {"name": "pilot", "seed": 1}}``.
    out
        Folder for ``design.json``, ``waveform.csv``, ``study.toml`` and the cube of the verification. When None,
        nothing is written and nothing verified.
    model
        A `Model`, a name or the file of one, instead of that of ``file``.
    verify
        Whether to run the Monte Carlo study of design and sequence.
    workers
        Threads of the verification; one per core when None.
    scheduler
        Address of a running Dask scheduler, ``tls://host:port``; threads of this process when None.

    Returns
    -------
    StimulusDesign
        Print ``text()``; ``waveform(rate_hz)`` gives one cycle, ``study`` a study with it, ``to_dict()`` everything.

    Raises
    ------
    DesignError
        The file has a mistake, or its limits allow no stimulus.
    Interrupted
        The verification was stopped; the same call resumes it.
    """
    asked = parse_design(with_model(file, model)) if isinstance(file, dict) else read_design(file, model)
    options = ClusterOptions(workers=workers, scheduler=scheduler)
    record = design_stimulus(asked, None if out is None else local_path(out), options, verify)
    return StimulusDesign.of(record)
