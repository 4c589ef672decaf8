"""Private parts of libraries may vanish with any version: only one module, behind its guard, uses any."""

from __future__ import annotations

import ast
from pathlib import Path

import mcstudy

PACKAGE = Path(mcstudy.__file__).parent

GUARDED = {"compiling/numba_internals.py"}
"""Modules that use private parts: of numba, checked before they are used; without them functions are compiled anew."""

DOCUMENTED = {"_replace", "_asdict", "_make", "_fields"}
"""Methods of named tuples."""


def _private(name: str) -> bool:
    return any(part.startswith("_") and not part.startswith("__") for part in name.split("."))


def _typing_only(tree: ast.Module) -> set[ast.AST]:
    """What is under ``if TYPE_CHECKING`` and never runs."""
    blocks = [n for n in ast.walk(tree) if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    return {inner for block in blocks for statement in block.body for inner in ast.walk(statement)}


def _defined(tree: ast.Module) -> set[str]:
    """Names that a module defines or sets."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.attr)
    return names


def foreign_internals(tree: ast.Module, ours: set[str]) -> list[str]:
    """Private names of other packages that a module uses; ``ours``: the names that this package defines."""
    used = []
    for node in set(ast.walk(tree)) - _typing_only(tree):
        if isinstance(node, ast.Attribute) and _private(node.attr) and node.attr not in ours | DOCUMENTED:
            used.append(node.attr)
        elif isinstance(node, ast.ImportFrom) and not (node.module or "").startswith("mcstudy"):
            used += [f"{node.module}.{a.name}" for a in node.names if _private(f"{node.module}.{a.name}")]
        elif isinstance(node, ast.Import):
            used += [a.name for a in node.names if _private(a.name)]
    return used


def test_private_parts_of_libraries_are_used_by_one_guarded_module() -> None:
    trees = {file: ast.parse(file.read_text(encoding="utf-8")) for file in PACKAGE.rglob("*.py")}
    ours = set().union(*map(_defined, trees.values()))
    found = {str(file.relative_to(PACKAGE)): foreign_internals(tree, ours) for file, tree in trees.items()}
    assert {name: used for name, used in found.items() if used and name not in GUARDED} == {}
    assert all(found[name] for name in GUARDED)


def test_every_form_of_use_is_seen() -> None:
    uses = ["parser._actions", "from pydantic._internal import x", "import zarr.core._info", "from xarray import _y"]
    for use in uses:
        assert foreign_internals(ast.parse(use), ours=set()), use
    assert not foreign_internals(ast.parse("if TYPE_CHECKING:\n    from pydantic._internal import x"), set())
    assert not foreign_internals(ast.parse("self._own; record._replace(a=1)"), {"_own"})
