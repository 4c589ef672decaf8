"""Designing a stimulus, verifying it by Monte Carlo and writing what was found.

    OUT/design.json        the design, its predictions and its verification
    OUT/waveform.csv       one cycle at the laboratory's rate
    OUT/study.toml         a study of design and sequence
    OUT/verification.zarr  the fits of the verification

The design follows from its file alone, so a stopped verification resumes with the same call.
"""

from __future__ import annotations

from pathlib import Path

from mcstudy.analysis.results import open_results
from mcstudy.files.csv_text import csv_text
from mcstudy.files.json_files import ensure_folder, own_folder, write_json, write_text
from mcstudy.files.local_path import resolved
from mcstudy.scheduler.activity import activity
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stimulus_design.design_file import DesignFile
from mcstudy.stimulus_design.design_record import StimulusDesignRecord, design_record
from mcstudy.stimulus_design.spectrum import designed
from mcstudy.stimulus_design.verify import verification_of
from mcstudy.study.cube.repair import refuse_part
from mcstudy.study.run import held, run_study

CUBE = "verification.zarr"

DOCUMENT = "design.json"
"""File of a design, in its folder."""


def design_stimulus(
    file: DesignFile, out: Path | None, options: ClusterOptions | None = None, verify: bool = True
) -> StimulusDesignRecord:
    """The optimal stimulus of a design file, verified and written into the folder ``out`` where there is one.

    Without ``out`` or with ``verify`` false, or with ``verify.realizations = 0``, nothing is simulated.

    Raises
    ------
    DesignError: the limits allow no stimulus.
    StoreError: the folder holds other files.
    StudyChangedError: the folder holds the verification of another design.
    Interrupted: the verification was stopped; the same call resumes.
    """
    if out is not None:
        refuse_part(resolved(out))
        own_folder(out, DOCUMENT, "a design")
    with activity(f"{file.design.name}: designing the stimulus"):
        optimum = designed(file)
        design = design_record(optimum)
    if out is None:
        return design
    study = verification_of(optimum) if file.verify.realizations else None
    if study is not None:
        held(out / CUBE, study)  # refused before anything is written
    write_design(design, out)  # there while the study runs, and if it is stopped
    if verify and study is not None:
        run_study(study, out / CUBE, options)
        design = design_record(optimum, open_results(out / CUBE, lazy=None))
        write_design(design, out)
    return design


def write_design(design: StimulusDesignRecord, out: Path) -> None:
    """Write ``design.json``, ``waveform.csv`` and ``study.toml`` into a folder."""
    ensure_folder(out)
    write_json(out / DOCUMENT, design.to_dict(), "stimulus_design")  # first: it marks the folder as a design's
    write_text(out / "waveform.csv", waveform_csv(design))
    write_text(out / "study.toml", design.study.to_toml().rstrip("\n"))


def waveform_csv(design: StimulusDesignRecord) -> str:
    """The waveform of one cycle as text."""
    rows = ((f"{time:.6f}", f"{value:.9g}") for time, value in zip(*design.waveform(), strict=True))
    return csv_text(["time (s)", f"stimulus ({design.designed.model.stimulus_unit})"], rows)
