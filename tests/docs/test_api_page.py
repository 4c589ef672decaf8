"""The page of the Python interface names all of it."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import mcstudy
from mcstudy.analysis.accessor import MonteCarlo
from mcstudy.report.diagnosis.plots import Plots

PACKAGE = Path(mcstudy.__file__).parent
PAGE = (PACKAGE / "API.md").read_text(encoding="utf-8")


def public(kind: type) -> list[str]:
    return [name for name in vars(kind) if not name.startswith("_")]


def test_every_name_is_on_the_page() -> None:
    assert [n for n in mcstudy.__all__ if not re.search(rf"mc\.{n}\b", PAGE)] == []


def test_every_statistic_and_every_figure_of_a_diagnosis_is_on_the_page() -> None:
    assert [n for n in (*public(MonteCarlo), *public(Plots)) if f"`{n}`" not in PAGE] == []


def test_every_parameter_of_a_public_function_is_described() -> None:
    functions = {n: getattr(mcstudy, n) for n in mcstudy.__all__}
    functions |= {f"mc.{n}": getattr(MonteCarlo, n) for n in public(MonteCarlo)}
    functions |= {f"Study.{n}": getattr(mcstudy.Study, n) for n in ("group",)}
    missing = []
    for name, function in functions.items():
        if not inspect.isfunction(function):
            continue
        described = re.findall(r"^(?:\*\*)?(\w+(?:, \w+)*)$", inspect.getdoc(function) or "", re.MULTILINE)
        entries = {entry for line in described for entry in line.split(", ")}
        missing += [f"{name}({p})" for p in inspect.signature(function).parameters if p not in {"self", *entries}]
    assert missing == []


def test_every_folder_is_on_the_map() -> None:
    page = (PACKAGE / "README.md").read_text(encoding="utf-8")
    folders = {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").exists()}
    modules = {p.name for p in PACKAGE.glob("*.py")} - {"__init__.py", "__main__.py"}
    assert [n for n in folders | modules if f"`{n}`" not in page] == []
