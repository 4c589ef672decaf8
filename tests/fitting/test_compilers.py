"""Other processes compile what is compiled nowhere yet; this one then loads it, and so does everybody after it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from linked_segments import model

from mcstudy.fitting import compilers, warm
from mcstudy.fitting.problem import small_problem
from mcstudy.fitting.solvers import fit
from mcstudy.fitting.warm import PARTS
from mcstudy.study import kernels
from mcstudy.study.design import FitSection, Group

PART = "time_domain"

SCRIPT = """
import sys
from numba.core import event

class Count(event.Listener):
    own = 0
    def on_start(self, event):
        Count.own += 1
    def on_end(self, event):
        pass

event.register("numba:compile", Count())
from mcstudy.fitting.compilers import warm
lines = []
print(warm([sys.argv[1]], lambda c: lines.append(c.line())), Count.own, len(lines) > 0)
"""


def test_what_is_missing_is_compiled_by_others_and_only_once(tmp_path: Path) -> None:
    """Two at once, as workers of a cluster start, then one more; the number of functions is the declared one."""
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    call = [sys.executable, "-c", SCRIPT, PART]
    both = [subprocess.Popen(call, env=variables, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = sorted(process.communicate()[0].split() for process in both)
    assert said == [["0", "0", "True"], [str(PARTS[PART].functions), "0", "True"]]
    later = subprocess.run(call, env=variables, capture_output=True, text=True, check=True)
    assert later.stdout.split() == ["0", "0", "False"]


def test_a_process_that_fails_leaves_its_work_to_this_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = []
    monkeypatch.setattr(compilers, "missing", lambda parts: list(parts))
    monkeypatch.setattr(compilers, "folder_of", lambda _: tmp_path)
    monkeypatch.setattr(compilers, "compile_here", lambda parts: made.extend(parts) or len(made))
    monkeypatch.setattr(sys, "executable", "/bin/false")
    assert compilers.warm(["gram", "lm"]) == 2
    assert made == ["gram", "lm"]


def test_where_nothing_can_be_kept_no_process_is_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilers, "missing", lambda parts: list(parts))
    monkeypatch.setattr(compilers, "folder_of", lambda _: None)
    assert compilers.begin(["lm"]) is None


def test_parts_are_compiled_after_those_they_call(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm, "load", lambda part: part == "steps")
    assert warm.missing(["lm", "stability"]) == ["stability", "gram", "lm"]
    for name, part in PARTS.items():
        assert all(list(PARTS).index(before) < list(PARTS).index(name) for before in part.after)


def test_a_study_of_three_joints_needs_code_for_three_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "build_model", lambda _group: model(3))
    group = Group(realizations=1, starts=1, fmax=[1.2], amplitude=[5.0], fit=FitSection(starts="linearised"))
    assert kernels.parts_of([group]) == ["stability", "linearised:3", "lm:3"]
    assert warm.with_called(["lm:3", "lm"]) == ["gram", "gram:3", "lm", "lm:3"]
    assert PARTS["lm:3"].after == ("steps",)
    problem = small_problem(3)
    assert problem.model.n_rows == 3
    assert fit(problem, problem.model.truth[None]).cost[0] < 1e-20


def test_a_process_that_compiles_a_part_leaves_what_it_calls_to_another(tmp_path: Path) -> None:
    script = (
        "from mcstudy.fitting.kernel import evaluate, levenberg_marquardt\n"
        "from mcstudy.fitting.warm import compile_part\n"
        "compile_part('lm')\n"
        "print(len(levenberg_marquardt.dispatcher.overloads), len(evaluate.overloads))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment)
    assert ran.stdout.split() == ["1", "0"], ran.stderr
