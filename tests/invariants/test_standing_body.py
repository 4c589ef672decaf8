"""Only what is about the standing body, or about recordings of it, names its joints, angles or model."""

from __future__ import annotations

import re
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "mcstudy"

NAMES = re.compile(r"theta1|theta2|two_segment|[\"']hip[\"']|[\"']ankle[\"']")

ABOUT = {
    "models by name": {"models/__init__.py", "models/catalogue.py", "models/record.py"},
    "studies of it": {"study/group.py", "study/models.py"},
    "options that say what is meant without a declared model": {
        "cli/recording_options.py",
        "cli/verbs/import.py",
        "cli/verbs/simulate.py",
    },
    "the library of effects, which attaches to it": {
        "effect_library/declarations.py",
        "effect_library/edits.py",
        "effect_library/effect.py",
        "effect_library/protocol.py",
        "effect_library/simulation.py",
        "gap/nearest_words.py",
        "gap/questions/mislabelling.py",
        "gap/trial_planning/predictions.py",
    },
    "recordings of it, their labels and published responses": {
        "lines/labels.py",
        "lines/readings.py",
        "recordings/channels.py",
        "recordings/columns.py",
        "recordings/frf.py",
        "recordings/frf_group.py",
        "recordings/recording.py",
        "recordings/sheets/frf_group_sheet.py",
        "recordings/sheets/recording_sheet.py",
        "recordings/units.py",
        "spectra/frf_groups.py",
    },
    "groups of people": {"group_comparison/changes.py", "group_comparison/group_model.py"},
    "coverage that was simulated with it": {"identification/simulated_coverage.py"},
    "pages and figures": {
        "report/diagnosis/plots.py",
        "report/figures/responses.py",
        "report/labels.py",
        "report/person/plots.py",
        "report/study/paths.py",
    },
}
"""Files outside ``stance`` by what they are about."""


def test_no_other_file_names_the_joints_of_the_standing_body() -> None:
    naming = {
        file.relative_to(PACKAGE).as_posix()
        for file in PACKAGE.rglob("*.py")
        if "stance" not in file.relative_to(PACKAGE).parts and NAMES.search(file.read_text(encoding="utf-8"))
    }
    known = set().union(*ABOUT.values())
    assert naming - known == set(), "take the names from the model"
    assert known - naming == set(), "no longer about the standing body: take it off the list"
