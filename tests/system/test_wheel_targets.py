"""Which machines a wheel has code for, what its tag says then, and what it is where it has none."""

from __future__ import annotations

import importlib.util
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("hatchling")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="wheels hold compiled code for Linux")

ROOT = Path(__file__).parents[2]
TRIPLES = {"x86_64": "x86_64-unknown-linux-gnu", "aarch64": "aarch64-unknown-linux-gnu"}
PURE = {"pure_python": True, "infer_tag": False, "force_include": {}}


@pytest.fixture
def hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "pipelines" / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def built(hook: ModuleType) -> tuple[dict[str, Any], list[str]]:
    """What the hook tells the builder, and its warnings."""
    warnings: list[str] = []
    one = hook.CompiledKernels(str(ROOT), {}, None, None, "", "wheel")
    one._BuildHookInterface__app = SimpleNamespace(display_warning=warnings.append)
    data: dict[str, Any] = {**PURE, "force_include": {}}
    one.initialize("standard", data)
    one.finalize("standard", data, "")
    return data, warnings


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_a_wheel_has_the_code_of_the_machine_that_builds_it_and_its_tag(
    machine: str, hook: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, str]] = []

    def run(_: list[str], env: dict[str, str], **__: object) -> SimpleNamespace:
        asked.append(env)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(subprocess, "run", run)
    data, warnings = built(hook)
    assert not warnings
    assert (data["pure_python"], data["infer_tag"]) == (False, True)
    assert list(data["force_include"].values()) == ["mcstudy/_compiled"]
    assert {env["NUMBA_CPU_NAME"] for env in asked} == {t.cpu for t in hook.TARGETS[machine]}


@pytest.mark.parametrize("machine", ["riscv64", "ppc64le", "armv7l"])
def test_elsewhere_a_wheel_is_for_any_machine(machine: str, hook: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(hook, "_compile", lambda *_: pytest.fail("compiled"))
    assert built(hook) == (PURE, [])


def test_a_wheel_that_could_not_be_compiled_is_for_any_machine_and_says_why(
    hook: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(hook, "_compile", lambda *_: "no compiler")
    data, warnings = built(hook)
    assert data == PURE
    assert warnings == ["the wheel is built without code for armv8-a: no compiler"]


def test_a_wheel_keeps_what_could_be_compiled_where_one_kind_of_processor_could_not(
    hook: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A builder without AVX-512 cannot run the code for it, and so cannot compile it."""
    kept: list[Path] = []

    def _compile(_: Path, target: Any, code: Path, __: Path) -> str:
        code.mkdir(parents=True)
        kept.append(code.parent)
        return "illegal instruction" if target.name == "x86-64-v4" else ""

    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(hook, "_compile", _compile)
    monkeypatch.setattr(hook.CompiledKernels, "finalize", lambda *_: None)  # what is packed is looked at here
    data, warnings = built(hook)
    assert [folder.name for folder in kept[0].iterdir()] == ["x86-64-v3"]
    assert (data["pure_python"], data["infer_tag"]) == (False, True)
    assert warnings == ["the wheel is built without code for x86-64-v4: illegal instruction"]
    shutil.rmtree(kept[0].parent)


@pytest.mark.parametrize("machine", TRIPLES)
def test_the_compiler_knows_the_processor_and_its_features(
    machine: str, hook: ModuleType, capfd: pytest.CaptureFixture[str]
) -> None:
    """It makes code for other machines too, and tells of a name that it does not know."""
    from llvmlite import binding

    binding.initialize_all_targets()
    target = binding.Target.from_triple(TRIPLES[machine])
    for one in hook.TARGETS[machine]:
        target.create_target_machine(cpu=one.cpu, features=",".join(f"+{name}" for name in one.features))
    assert capfd.readouterr().err == ""
    target.create_target_machine(cpu=hook.TARGETS[machine][0].cpu, features="+nonsense")
    assert "nonsense" in capfd.readouterr().err
