"""Everything the command line does is a function: each verb and the public function call the same worker."""

from __future__ import annotations

import ast
import importlib
import inspect
from pathlib import Path

import pytest

import mcstudy as mc
from mcstudy.cli.verbs import module, verbs

WORKERS = {
    "studies": {"studies": "mcstudy.study.catalogue:shipped"},
    "warm": {"warm": "mcstudy.fitting.compilers:warm"},
    "plan": {"plan": "mcstudy.study.plan:plan_study"},
    "run": {"run": "mcstudy.study.run:run_study", "run_until": "mcstudy.api.cubes:run_until"},
    "status": {"status": "mcstudy.api.cube_status:status"},
    "verify": {"verify": "mcstudy.study.verify:verify"},
    "extend": {"extend": "mcstudy.study.extend:extend"},
    "replay": {"replay": "mcstudy.study.replay:replay"},
    "show": {"summary": "mcstudy.analysis.show.tables:show"},
    "report": {"write_report": "mcstudy.report.page:page"},
    "performance": {"performance": "mcstudy.api.performance:performance"},
    "simulate": {
        "simulate": "mcstudy.effect_library.simulation:simulate",
        "write_recording": "mcstudy.recordings.io:write_recording",
    },
    "import": {"import_recording": "mcstudy.recordings.laboratory_import:import_files"},
    "fit": {
        "fit": "mcstudy.identification.fit:fit",
        "fit_conditions": "mcstudy.identification.conditions.fit:fit_conditions",
        "fit_group": "mcstudy.identification.people.fits:fit_members",
    },
    "study-from": {"study_from": "mcstudy.identification.study_design:study_of"},
    "design": {"design": "mcstudy.stimulus_design.run:design_stimulus"},
    "solve": {"solve": "mcstudy.planning.solve:solve_study"},
    "gap": {
        "diagnose": "mcstudy.gap.diagnose:diagnose",
        "next_trial": "mcstudy.gap.trial_planning.next_trial:next_trial",
        "compare": "mcstudy.api.compare:compare",
    },
}
"""Verb: public functions, and what both call."""

ELSEWHERE = {
    "infer": "mcstudy_goodworth2018.infer.infer, of the package that adds the verb",
    "models": "mcstudy.models.catalogue",
    "figure": "mcstudy.report.figures, whose functions draw the panels",
    "help": "about the command line itself",
    "completion": "about the command line itself",
}


def imported(file: Path) -> set[str]:
    """``module:name`` of everything that a file imports by name, and of what it defines."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    froms = (n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom))
    return {f"{n.module}:{a.name}" for n in froms for a in n.names}


@pytest.mark.parametrize("verb", WORKERS)
def test_a_verb_and_its_functions_call_the_same_worker(verb: str) -> None:
    of_verb = imported(Path(module(verb).__file__))
    for name, worker in WORKERS[verb].items():
        assert name in mc.__all__
        assert worker in of_verb, f"{verb} does not call it"
        function = getattr(mc, name)
        itself = f"{function.__module__}:{function.__name__}"
        assert worker == itself or worker in imported(Path(inspect.getfile(function))), f"mc.{name} does not call it"


def test_no_verb_is_without_a_function() -> None:
    assert set(verbs()) == {*WORKERS, *ELSEWHERE}
    place, _, name = ELSEWHERE["infer"].partition(",")[0].rpartition(".")
    assert inspect.isfunction(getattr(importlib.import_module(place), name))


def test_the_studies_are_listed_by_what_they_answer() -> None:
    assert "goodworth2018" in mc.studies()
    assert all(mc.studies().values())
