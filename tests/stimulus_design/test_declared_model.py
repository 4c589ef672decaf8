"""A design file may name a declared model: bodies differ in its parameters, sway has its names and unit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mcstudy.errors import DesignError
from mcstudy.files import schema
from mcstudy.models.catalogue import checked_table, written
from mcstudy.results.stimulus_design import StimulusDesign
from mcstudy.stimulus_design.design_file import read_design
from mcstudy.stimulus_design.run import design_stimulus
from tests.helpers.declared import ELBOW

DESIGN = """model = "elbow.toml"
[design]
name = "elbow"
seed = 1
amplitude = 1.0
fmax = 10.0
[prior]
bodies = 2
[limits]
bodies_within = 0.0
[verify]
realizations = 0
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "elbow.toml").write_text(written(checked_table(ELBOW)))
    (tmp_path / "design.toml").write_text(DESIGN)
    return tmp_path / "design.toml"


def test_a_design_above_8_hz_is_found_and_told_in_the_models_words(file: Path, tmp_path: Path) -> None:
    design = StimulusDesign.of(design_stimulus(read_design(file), tmp_path / "out", verify=False))
    assert design.designed.f.max() > 9.5
    assert np.all(design.cv[1] < design.cv[0])
    assert "RMS of evoked sway, elbow (deg)" in design.text()
    written_json = json.loads((tmp_path / "out" / "design.json").read_text())
    schema.validate("stimulus_design", written_json, "design")
    assert len(written_json["size"]["design"]["sway_rms"]) >= 1
    assert (tmp_path / "out" / "study.toml").read_text().count('name = "elbow"') >= 2


def test_two_models_cannot_be_told_apart_where_no_effect_attaches(file: Path) -> None:
    file.write_text(
        DESIGN.replace("amplitude = 1.0", 'amplitude = 1.0\ncriterion = "difference"\neffects = ["a", "b"]')
    )
    with pytest.raises(DesignError, match=r"design.criterion: expected D, A or c for a declared model"):
        read_design(file)
