"""The shipped examples as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

EXAMPLES = Path(__file__).parents[2] / "pipelines" / "examples"


def module(name: str) -> ModuleType:
    """``pipelines/examples/NAME.py``, imported anew."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[name] = loaded  # dataclasses look their module up by name
    spec.loader.exec_module(loaded)
    return loaded


def run_with_file(name: str, file: Path, text: str, monkeypatch: pytest.MonkeyPatch, *arguments: int) -> ModuleType:
    """The example after its ``main(*arguments)``, with ``text`` in place of the file that it reads (its ``FILE``)."""
    file.write_text(text)
    example = module(name)
    monkeypatch.setattr(example, "FILE", file)
    example.main(*arguments)
    return example
