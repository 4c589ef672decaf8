"""The origin of a group's true values says what is the paper's, what a stand-in, and what the user's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mcstudy.analysis.results import open_results
from mcstudy.analysis.view import GroupView
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.truths import TRUTHS
from mcstudy.study import models
from mcstudy.study.cube import store
from mcstudy.study.group import Group
from mcstudy.study.models import build_model, earlier_provenance
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

OWN = {name: 0.99 * value for name, value in TRUTHS["stand_in"].values.items()}

LIGHT = {"J1": 60.0}
"""Another body than the paper's."""

AIM = "until the study reproduces the paper's published aggregates"

CASES: list[tuple[dict[str, Any], str]] = [
    ({}, f"body and Kpas1 are the paper's, the other gains were calibrated {AIM}"),
    ({"truth": {"K11": 900.0}}, f"body and Kpas1 are the paper's, the other gains were calibrated {AIM}; {{}}: K11"),
    ({"truth": {"Kpas1": 150.0}}, f"body is the paper's, the other gains were calibrated {AIM}; {{}}: Kpas1"),
    ({"body": LIGHT}, f"Kpas1 is the paper's, the other gains were calibrated for the paper's body {AIM}; {{}}: body"),
    (
        {"body": LIGHT, "truth": {"Kpas1": 150.0}},
        f"the other gains were calibrated for the paper's body {AIM}; {{}}: body, Kpas1",
    ),
    ({"kind": "one_segment", "truth": {"K": 900.0}}, "body and Kpas are the paper's, {}: K"),
    ({"truth": OWN}, "your values (study file); the body is the paper's"),
    ({"truth": OWN, "body": LIGHT}, "your values (study file); the body is yours, too"),
    ({"truth": "inferred"}, TRUTHS["inferred"].provenance),
    ({"truth": "inferred", "body": LIGHT}, TRUTHS["inferred"].provenance + "; {}: body"),
]


def group(model: dict[str, Any], kind: str = "ankle_torque") -> Group:
    return Group(realizations=1, starts=1, fmax=[1.2], amplitude=[1.0], model=model, stimulus={"kind": kind})


@pytest.mark.parametrize(("model", "said"), CASES)
def test_what_is_the_users_is_not_called_the_papers(model: dict[str, Any], said: str) -> None:
    for part in said.replace("{}", "replaced by the study file").split("; "):
        first, _, last = part.partition(", replaced")
        assert first in build_model(group(model)).provenance
        assert last in build_model(group(model)).provenance
    provenance = build_model(group(model)).provenance
    assert ("body and" in provenance or "body is the paper's" in provenance) == ("body" not in model) or (
        model.get("truth") == "inferred"
    )


def test_the_weight_of_a_tilt_is_a_stand_in_unless_the_user_states_it() -> None:
    stated = build_model(group({"truth": {"Wprop": 0.6}}, "surface_tilt")).provenance
    assert "weight" not in stated
    assert stated.endswith("replaced by the study file: Wprop")
    for truth in ({}, "inferred"):
        named = build_model(group({"truth": truth}, "surface_tilt")).provenance
        assert named.endswith("the sensory weight is a round stand-in as well")
        assert named.startswith("inferred" if truth else "stand-in")


def test_the_words_for_the_paper_s_values_are_those_of_older_programs() -> None:
    for model in ({}, {"truth": "inferred"}, {"truth": {"K11": 900.0}}):
        assert build_model(group(model)).provenance == earlier_provenance(group(model))


def test_a_cube_of_an_older_program_is_shown_with_what_is_true_and_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = parse_study(
        '[study]\nname = "own"\nseed = 1\n[group.a]\nrealizations = 1\nstarts = 1\nfmax = [1.2]\namplitude = [5.0]\n'
        "[group.a.model.body]\nJ1 = 60.0\n[group.a.model.truth]\nKpas1 = 150.0\n"
    )
    out = tmp_path / "own.zarr"
    with monkeypatch.context() as patch:
        patch.setattr(models, "_provenance", lambda *_: earlier_provenance(study.groups["a"]))
        here = store.environment()
        patch.setattr(store, "environment", lambda: {**here, "source": "0" * 64})
        run_study(study, out, ClusterOptions(workers=1))
    cube = open_results(out)["a"].to_dataset()
    assert "body and Kpas1 are the paper's" in cube.attrs["truth_provenance"]
    view = GroupView("a", cube)
    assert view.provenance.endswith("replaced by the study file: body, Kpas1")
    assert "are the paper's" not in view.provenance
    assert verify(out, cells=0).damage == []
    file = out / "a" / "zarr.json"
    file.write_bytes(file.read_bytes().replace(b"body and Kpas1 are", b"body and Kpas1 arx"))
    assert [line for line in verify(out, cells=0).damage if "truth_provenance" in line or "zarr.json" in line]
