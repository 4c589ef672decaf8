"""The two pictures of the README: ``python -m pipelines.docs --pictures`` runs what they show, in about a minute."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure

import mcstudy as mc
from mcstudy.cli.figure_file import write_figure
from mcstudy.report import figures
from mcstudy.report.axes import picture

FOLDER = Path(__file__).parent / "pictures"

SIZE = (4.6, 4.2)
"""Inches of each."""

DPI = 110.0


def write_pictures() -> None:
    """Run the paper's study, and diagnose a recording with a known missing effect."""
    FOLDER.mkdir(exist_ok=True)
    with TemporaryDirectory() as folder:
        study = mc.run("goodworth2018", Path(folder) / "study.zarr")
        write_figure(determined(study["accuracy"]), FOLDER / "determined.png", DPI)
    recording = mc.simulate(effects={"passive_damping_ankle": 40.0}, cycles=12, rate_hz=100.0, seed=3)
    write_figure(gap(mc.diagnose(recording, fast=True)), FOLDER / "gap.png", DPI)


def determined(group: object) -> Figure:
    """What the paper's experiment tells of each parameter."""
    return picture([lambda ax: figures.determined_dots(group, ax=ax)], "What one experiment tells", size=SIZE)


def gap(diagnosis: mc.Diagnosis) -> Figure:
    """Where the model fails, and what causes it."""
    return picture([lambda ax: diagnosis.plot.causes(ax=ax)], "Which effect is missing", size=SIZE)
