"""The rooms of the package: which there are, that imports run one way, and where a change belongs."""

from __future__ import annotations

import ast
from collections import defaultdict
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import mcstudy
from mcstudy.study import environment

PACKAGE = Path(mcstudy.__file__).parent

LAYERS = (
    ("program", "errors", "exits", "expressions", "streams", "text_tables", "short_repr"),
    ("compiling",),
    ("stance",),
    ("files",),
    ("models",),
    ("recordings",),
    ("spectra",),
    ("fitting",),
    ("effect_library",),
    ("scheduler",),
    ("lines",),
    ("study", "gap"),
    ("identification",),
    ("analysis",),
    ("group_comparison", "planning", "stimulus_design"),
    ("adaptive", "own_model"),
    ("report",),
    ("results",),
    ("api",),
    ("cli",),
)
"""Rooms from the ground up: one may import those of lower layers, none of its own but itself."""

LEVEL = {room: level for level, rooms in enumerate(LAYERS) for room in rooms}

LARGEST_SHARE = 1 / 6
"""Of the package's lines in one room."""


WINGS = tuple((PACKAGE.parent / "pipelines").glob("mcstudy_*"))


def modules(package: Path) -> dict[str, Path]:
    """Dotted name and file of every module, the package itself left out."""
    files = {}
    for file in package.rglob("*.py"):
        parts = file.relative_to(package).with_suffix("").parts
        files[".".join(p for p in parts if p != "__init__")] = file
    return {name: file for name, file in files.items() if name not in ("", "__main__")}


MODULES = modules(PACKAGE)


def imported(file: Path, package: str = "mcstudy", modules: dict[str, Path] = MODULES) -> set[str]:
    """Modules of the package that a file imports anywhere, for types too."""
    out = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{a.name}" for a in node.names]
        for name in names:
            local = name.removeprefix(f"{package}.")
            if name.startswith(f"{package}."):
                out.add(local if local in modules else local.rpartition(".")[0])
    return out - {""}


def test_nothing_names_a_wing() -> None:
    """A wing imports the package and attaches to it by entry points."""
    wings = [wing.name for wing in WINGS]
    texts = {name: file.read_text(encoding="utf-8") for name, file in MODULES.items()}
    assert len(wings) == 3
    assert [(name, wing) for name, text in texts.items() for wing in wings if wing in text] == []


def test_every_room_has_a_layer() -> None:
    assert {name.split(".")[0] for name in MODULES} == set(LEVEL)


def test_imports_run_one_way() -> None:
    wrong = [
        f"{name} imports {other}"
        for name, file in MODULES.items()
        for other in imported(file)
        if (here := name.split(".")[0]) != (there := other.split(".")[0])
        and LEVEL[there] >= LEVEL[here]
        and not LEVEL[here] == LEVEL[there] == 0
    ]
    assert wrong == []


def steps(package: Path, folder: str = "", parts: int = 0) -> dict[str, set[str]]:
    """What the modules in a folder of a package import from each other; ``parts`` of their names are told apart."""
    files, graph = modules(package), defaultdict[str, set[str]](set)
    for name in [name for name in files if name.startswith(folder)]:
        for other in imported(files[name], package.name, files) & files.keys():
            if other.startswith(folder):
                here, there = (".".join(n.split(".")[: parts or None]) for n in (name, other))
                graph[here] |= {there} - {here}
    return graph


@pytest.mark.parametrize("package", [PACKAGE, *WINGS], ids=lambda package: package.name)
def test_no_module_imports_itself_through_others(package: Path) -> None:
    """Nor for types, nor in functions; the error names the circle."""
    TopologicalSorter(steps(package)).prepare()


@pytest.mark.parametrize(
    ("package", "folder", "parts"),
    [*((PACKAGE, f"{room}.", 2) for room in ("gap", "report", "analysis")), *((wing, "", 1) for wing in WINGS)],
)
def test_the_folders_of_a_room_do_not_go_in_circles(package: Path, folder: str, parts: int) -> None:
    """Nor with the modules beside them."""
    TopologicalSorter(steps(package, folder, parts)).prepare()


def test_no_room_holds_more_than_a_sixth_of_the_house() -> None:
    lines: dict[str, int] = defaultdict(int)
    for name, file in MODULES.items():
        lines[name.split(".")[0]] += len(file.read_text(encoding="utf-8").splitlines())
    room, most = max(lines.items(), key=lambda item: item[1])
    assert most <= LARGEST_SHARE * sum(lines.values()), room


def test_recordings_estimate_nothing_and_spectra_alone_estimate() -> None:
    numeric = ("fft", "linalg", "signal")
    for name, file in MODULES.items():
        if name.startswith("recordings."):
            tree = ast.parse(file.read_text(encoding="utf-8"))
            used = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and n.attr in numeric}
            assert used <= {"fft"}, name  # one finds the period that a wrong one is compared with
            if name != "recordings.resampling":  # changes rates and fills gaps
                assert "scipy" not in file.read_text(encoding="utf-8"), name


def test_the_source_that_a_cube_notes_is_all_that_its_numbers_come_from() -> None:
    found, todo = set(), {"study.execution.tasks"}
    while todo:
        found |= todo
        todo = {other for name in todo for other in imported(MODULES[name])} - found
    held = {layer.removesuffix(".py") for layer in environment.LAYERS}
    words = {"errors", "exits", "program", "text_tables", "short_repr", "scheduler"}
    assert {name.split(".")[0] for name in found} - words <= held
