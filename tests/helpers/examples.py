"""The shipped examples and the validation experiments as modules."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

PLACES = tuple(Path(__file__).parents[2] / "pipelines" / folder for folder in ("examples", "validation"))


def module(name: str) -> ModuleType:
    """``NAME.py`` of `PLACES`, imported anew."""
    file = next(folder / f"{name}.py" for folder in PLACES if (folder / f"{name}.py").exists())
    spec = importlib.util.spec_from_file_location(name, file)
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
