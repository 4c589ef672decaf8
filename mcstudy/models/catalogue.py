"""Models by name: those that ship with mcstudy, those that other packages bring, and model files.

A model file is TOML with a table ``[model]`` (`mcstudy.models.record.ModelTable`), which a study file may hold, too.
Those in ``pipelines/models`` ship under the names of their files. Another package names in the entry point group
``mcstudy.models`` a `Model`, a function that returns one, or the path of a model file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from os import PathLike
from pathlib import Path
from typing import Any

from mcstudy.errors import DesignError
from mcstudy.files.local_path import local_path
from mcstudy.files.packaged import packaged
from mcstudy.files.plain_errors import shown, validated
from mcstudy.files.toml_files import parse_toml, read_text, toml_lines
from mcstudy.models import DESCRIPTIONS
from mcstudy.models.record import ModelTable, table_of
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.text_tables import similar

GROUP = "mcstudy.models"

BUILT: dict[str, Callable[[], Model]] = {"two_segment": two_segment, "one_segment": one_segment}
"""Models of the body of Goodworth & Peterka (2018): a study file gives them a body and a kind of stimulus."""

DECLARED = "declared"
"""What a design calls the kind of a model whose table it holds."""


def names() -> dict[str, Callable[[], ModelTable]]:
    """Every model that has a name, with what reads it."""
    found: dict[str, Callable[[], ModelTable]] = {}
    for name, build in BUILT.items():
        found[name] = lambda build=build: ModelTable.of(build())  # type: ignore[misc]
    for file in sorted(packaged("pipelines").glob("models/*.toml")):
        found[file.stem] = lambda file=file: read_model_file(file)  # type: ignore[misc]
    for point in sorted(entry_points(group=GROUP)):
        if point.name in found:
            raise DesignError(
                f"model {point.name}: expected a name of its own, got that of another model ({point.value})"
            )
        found[point.name] = lambda point=point: _brought(point.name, point.load())  # type: ignore[misc]
    return found


def describe(name: str, table: ModelTable) -> str:
    """What a model is, in one line."""
    return DESCRIPTIONS.get(name, table.description)


def read_model(name: str | Path, folder: Path | None = None) -> ModelTable:
    """The table of a model: by its name, or of a file (a path that ends in .toml, relative to ``folder``).

    Raises `DesignError`, one line that names the file and the field.
    """
    if str(name).endswith(".toml"):
        path = local_path(name)
        return read_model_file(path, follow=True) if folder is None else read_model_file(folder / path)
    known = names()
    if str(name) not in known:
        raise DesignError(
            f"expected a model file (.toml) or one of {', '.join(known)}, got {shown(str(name))!r}"
            f"{similar(str(name), known)}"
        )
    return known[str(name)]()


def read_model_file(path: Path, *, follow: bool = False) -> ModelTable:
    """The table of a model file, checked; raises `DesignError`, one line that names the file and the field.

    ``follow``: the file may be a study's, which names its model instead of holding it.
    """
    text = read_text(path, "model file")
    try:
        given = parse_toml(text, "model file").get("model")
        if follow and (isinstance(given, str) or (isinstance(given, dict) and "kind" in given)):
            given = spelled_out(given, path.parent)
            if (kind := given.pop("kind")) != DECLARED:
                raise DesignError(f"model: expected a declared model, got {kind}: mcstudy models {kind}")
        if not isinstance(given, dict):
            raise DesignError("model: missing, expected a table [model] with joints, term and parameter")
        return checked_table(given)
    except DesignError as error:
        raise DesignError(f"{path}: {error}") from None


def checked_table(raw: Mapping[str, Any]) -> ModelTable:
    """The table of a model from plain values; raises `DesignError`, one line that starts with the field."""
    table: ModelTable = validated(ModelTable, raw, "model")
    try:
        table.model()
    except DesignError as error:
        raise DesignError(f"model.{error}") from None
    return table


def written(table: ModelTable) -> str:
    """The text of a model file."""
    return "\n".join(toml_lines("", {"model": table.model_dump(mode="json")})).lstrip() + "\n"


def spelled_out(given: Any, folder: Path | None = None) -> Any:
    """The table of a model that is given by its name, its file or as a `Model`, beside what else the table says.

    Names of models that a study builds (`BUILT`) stay names. Raises `DesignError` for an unknown one.
    """
    if isinstance(given, Model):
        return {"kind": DECLARED, **table_of(given)}
    if isinstance(given, str | PathLike):
        given = {"kind": str(given)}
    if not isinstance(given, Mapping):
        return given
    if "kind" not in given and given.keys() & {"joints", "parameter", "term"}:
        return {**given, "kind": DECLARED}
    if not isinstance(kind := given.get("kind"), str | PathLike):
        return given
    if str(kind) in (*BUILT, DECLARED):
        return given
    table = read_model(str(kind), folder).model_dump(mode="json")
    return {**table, **given, "kind": DECLARED}


def _brought(name: str, given: Any) -> ModelTable:
    """The table of what another package names."""
    if isinstance(given, str | PathLike):
        return read_model_file(Path(given))
    model = given() if callable(given) else given
    if not isinstance(model, Model):
        raise DesignError(f"model {name}: expected a Model, a function that returns one, or a file, got {type(model)}")
    return ModelTable.of(model)
