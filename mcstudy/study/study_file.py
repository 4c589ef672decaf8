"""Reading and writing study files.

A study file is TOML. Sections at the top level apply to every group; ``[group.NAME]`` gives a group its axes and may
repeat the same sections (``[group.NAME.fit]``) to override single keys. Every mistake gives one line:
``file: field: what was expected``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from mcstudy.errors import DesignError, InputError
from mcstudy.files.plain_errors import short, shown, validated
from mcstudy.files.sections import leaves
from mcstudy.files.toml_files import parse_toml
from mcstudy.models.catalogue import spelled_out
from mcstudy.stance.feedback import Model
from mcstudy.study.catalogue import located, read_file
from mcstudy.study.design import SECTIONS, Group, Study, StudySection
from mcstudy.study.group import with_lists
from mcstudy.study.sweep import expanded
from mcstudy.text_tables import similar


def read_study(path: str | Path, model: Model | str | Path | None = None) -> Study:
    """Read a study file (TOML).

    Parameters
    ----------
    path
        The file (``pipelines/README.md`` describes every field), or the name of a study that comes with mcstudy:
        ``goodworth2018``.
    model
        A `Model`, a name or the file of one, instead of the models that the file names.

    Raises
    ------
    DesignError
        The file cannot be read or has a mistake: one line that names file, field and what was expected.
    """
    folder = located(path).parent
    return read_file(path, "study", lambda raw: _study(with_model(raw, model), folder))


def parse_study(text: str) -> Study:
    """The resolved study of a study file's text; the one-line `DesignError` starts with the field."""
    return _study(parse_toml(text, "study file"))


def _study(raw: dict[str, Any], folder: Path | None = None) -> Study:
    if "model" in raw:
        raw = {**raw, "model": named_model(raw["model"], "model", folder)}
    check_tables(raw, ("study", *SECTIONS, "group"))
    if "study" not in raw:
        raise DesignError("study: missing, expected a table [study] with name and seed")
    if not raw.get("group"):
        raise DesignError("group: missing, expected at least one table [group.NAME]")
    validated(StudySection, raw["study"], "study")
    shared = {key: raw[key] for key in SECTIONS if key in raw}
    for key, value in shared.items():
        validated(Group.model_fields[key].annotation, value, key)
    groups: dict[str, Any] = {}
    for name, fields in raw["group"].items():
        where = f"group.{shown(name)}"
        if not isinstance(fields, dict):
            raise DesignError(f"{where}: expected a table [{where}], got {short(fields)}")
        base = shared
        if "model" in fields:
            fields = {**fields, "model": named_model(fields["model"], f"{where}.model", folder)}
            if _another(fields["model"], shared.get("model", {})):
                base = {key: value for key, value in shared.items() if key != "model"}
        for key in SECTIONS:
            if not isinstance(fields.get(key, {}), dict):
                raise DesignError(f"{where}.{key}: expected a table, got {short(fields[key])}")
        groups |= _cells(name, with_lists(merge(base, fields)), folder)
    study: Study = validated(Study, {"study": raw["study"], "group": groups})
    return study


def with_model(raw: dict[str, Any], model: Model | str | Path | None) -> dict[str, Any]:
    """The tables of a file with one ``model`` instead of those that the file names, in groups too."""
    if model is None:
        return raw
    try:
        table = spelled_out(model if isinstance(model, Model) else str(model))
    except DesignError as error:
        raise InputError(f"model: {error}") from None
    own = {"model": table}
    if isinstance(groups := raw.get("group"), dict):
        own["group"] = {
            name: {k: v for k, v in g.items() if k != "model"} if isinstance(g, dict) else g
            for name, g in groups.items()
        }
    return {**raw, **own}


def _cells(name: str, fields: dict[str, Any], folder: Path | None) -> dict[str, Any]:
    """A group, or those of its sweep."""
    cells = expanded(name, fields)
    for cell, own in cells.items():
        if isinstance(own.get("model"), str):  # of an axis of models
            own["model"] = named_model(own["model"], f"group.{shown(cell)}.model", folder)
        validated(Group, own, f"group.{shown(cell)}")
    return cells


def named_model(given: Any, where: str, folder: Path | None) -> Any:
    """The table of a model that may be given by its name or its file, beside which the study file lies."""
    try:
        return spelled_out(given, folder)
    except DesignError as error:
        raise DesignError(f"{where}{'' if isinstance(given, str) else '.kind'}: {error}") from None


def _another(own: Any, shared: Any) -> bool:
    """Whether a group names a model instead of that of the study, and does not only change its values."""
    tables = [t if isinstance(t, dict) else {} for t in (own, shared)]
    names = {"kind", "joints", "parameter", "term"}
    return bool(tables[0].keys() & names) and any(t.keys() & (names - {"kind"}) for t in tables)


def check_tables(raw: Mapping[str, Any], known: Collection[str]) -> None:
    """Raise `DesignError` unless everything at a file's top level is a table with one of the ``known`` names."""
    for key, value in raw.items():
        if key not in known:
            raise DesignError(f"{shown(key)}: unknown key, expected one of {', '.join(known)}{similar(key, known)}")
        if not isinstance(value, dict):
            raise DesignError(f"{key}: expected a table [{key}], got {short(value)}")


def merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with the keys of ``changes`` over it, table by table."""
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        merged[key] = merge(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged


def changes(old: Study, new: Study) -> list[str]:
    """What differs between two studies, as ``field = old, not new``, in the order of the file."""
    before, after = ({f: v for f, v in leaves(study.numbers()) if v != {}} for study in (old, new))
    lines = []
    for field in [*before, *(f for f in after if f not in before)]:
        if before.get(field) != after.get(field):
            sides = (short(side[field]) if field in side else "(absent)" for side in (before, after))
            lines.append(f"{field} = {', not '.join(sides)}")
    return lines
