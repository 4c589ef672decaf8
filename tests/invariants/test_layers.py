"""The rooms of the package: which there are, that imports run one way, and where a change belongs."""

from __future__ import annotations

import ast
from collections import defaultdict
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


def modules() -> dict[str, Path]:
    """Dotted name and file of every module, the package itself left out."""
    found = {}
    for file in PACKAGE.rglob("*.py"):
        parts = file.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(p for p in parts if p != "__init__")] = file
    return {name: file for name, file in found.items() if name not in ("", "__main__")}


MODULES = modules()


def imported(file: Path) -> set[str]:
    """Modules of the package that a file imports anywhere, for types too."""
    out = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{a.name}" for a in node.names]
        for name in names:
            local = name.removeprefix("mcstudy.")
            if name.startswith("mcstudy."):
                out.add(local if local in MODULES else local.rpartition(".")[0])
    return out - {""}


def test_nothing_names_a_wing() -> None:
    """A wing imports the package and attaches to it by entry points."""
    wings = [folder.name for folder in (PACKAGE.parent / "pipelines").glob("mcstudy_*")]
    texts = {name: file.read_text(encoding="utf-8") for name, file in MODULES.items()}
    assert len(wings) == 2
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


@pytest.mark.parametrize("room", ["gap", "report", "analysis"])
def test_the_floors_of_a_room_do_not_go_in_circles(room: str) -> None:
    """Between its folders; what lies beside them is above them."""
    floors: dict[str, set[str]] = defaultdict(set)
    for name, file in MODULES.items():
        parts = name.split(".")
        if parts[0] != room or len(parts) < 3:
            continue
        for other in imported(file):
            theirs = other.split(".")
            if theirs[0] == room and len(theirs) > 2 and theirs[1] != parts[1]:
                floors[parts[1]].add(theirs[1])
    for floor, below in floors.items():
        assert not any(floor in floors.get(b, ()) for b in below), (floor, below)


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
