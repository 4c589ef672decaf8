"""A compiled function calls another one at its address, and is compiled without it."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mcstudy.compiling.addresses import apart
from mcstudy.compiling.decorators import KEPT, folder_of

SOURCE = """
from mcstudy.compiling.decorators import compiled, inner
from mcstudy.compiling.addresses import call, calling

@inner
def part(x):
    return 2.0 * x

@compiled(allocates=False)
def step(plan, work):
    work[0] = part(work[0]) + plan[0]

@calling(step)
def repeat(step, plan, work, n):
    for _ in range(n):
        call(step, plan, work)
    return work[0]
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> ModuleType:
    name, before = f"separate_{abs(hash(request.node.name))}", len(KEPT)
    (tmp_path / f"{name}.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    made = importlib.import_module(name)
    del KEPT[before:]
    return made


def test_the_function_at_the_address_is_run_for_the_types_of_the_call(module: ModuleType) -> None:
    assert module.repeat(np.array([1.0]), np.array([3.0]), 2) == 2 * (2 * 3.0 + 1) + 1
    assert module.repeat(np.array([1]), np.array([3.0], dtype=np.float32), 2) == 15.0
    assert len(module.step.signatures) == len(module.repeat.dispatcher.signatures) == 2


def test_apart_the_caller_is_compiled_alone_and_nothing_is_run(module: ModuleType) -> None:
    work = np.array([3.0])
    with apart():
        module.repeat(np.array([1.0]), work, 2)
        pytest.fail("the block goes on after the call")
    assert work[0] == 3.0
    assert module.step.signatures == []
    assert len(module.repeat.dispatcher.signatures) == 1
    module.repeat(np.array([1.0]), work, 1)  # outside, it is run as ever
    assert work[0] == 7.0


def test_no_code_is_kept_of_a_function_that_is_only_part_of_others(module: ModuleType) -> None:
    module.repeat(np.array([1.0]), np.array([3.0]), 1)
    folder = folder_of(module.step)
    assert folder is not None
    kept = {file.name.split("-")[0] for file in folder.glob(f"{module.__name__}.*.nbi")}
    assert kept == {f"{module.__name__}.step", f"{module.__name__}.repeat"}
