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
from mcstudy.files.json_files import own_folder
from mcstudy.files.local_path import resolved
from mcstudy.scheduler.activity import activity
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stimulus_design.design_file import DesignFile
from mcstudy.stimulus_design.result import DOCUMENT, StimulusDesign
from mcstudy.stimulus_design.spectrum import designed
from mcstudy.stimulus_design.verify import verification_of
from mcstudy.study.cube.repair import refuse_part
from mcstudy.study.run import held, run_study

CUBE = "verification.zarr"


def design_stimulus(
    file: DesignFile, out: Path | None, options: ClusterOptions | None = None, verify: bool = True
) -> StimulusDesign:
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
        found = designed(file)
    if out is None:
        return StimulusDesign.of(found)
    study = verification_of(found) if file.verify.realizations else None
    if study is not None:
        held(out / CUBE, study)  # refused before anything is written
    if not verify or study is None:
        design = StimulusDesign.of(found)
        design.write(out)
        return design
    StimulusDesign.of(found).write(out)  # there while the study runs, and if it is stopped
    run_study(study, out / CUBE, options)
    design = StimulusDesign.of(found, open_results(out / CUBE, lazy=None))
    design.write(out)
    return design
