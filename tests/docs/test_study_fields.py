"""The table of study-file fields says what the schema says: every field, its default, what it may be."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from mcstudy.models.record import ModelTable
from mcstudy.study.design import Group, StudySection
from mcstudy.study.group import ModelSection
from mcstudy.study.study_file import read_study

PAGE = Path(__file__).parents[2] / "pipelines" / "README.md"
TYPES = {"integer": "whole number", "number": "number", "string": "text"}
LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def allowed(schema: dict[str, Any]) -> str:
    """What a field may be, in words."""
    if "anyOf" in schema:  # the other is null, which a file cannot hold
        return allowed(schema["anyOf"][0])
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    if schema["type"] == "array":
        items = schema.get("items") or schema["prefixItems"][0]
        count = "two" if "prefixItems" in schema else "list of"
        return f"{count}: {allowed(items)}"
    if schema["type"] == "object":
        return f"table of: {allowed(schema['additionalProperties'])}"
    if schema["type"] == "boolean":
        return "true, false"
    if "description" in schema:  # a range in words
        return str(schema["description"]).replace("a number", TYPES[schema["type"]])
    limits = ", ".join(f"{sign} {number(schema[key])}" for key, sign in LIMITS.items() if key in schema)
    return f"{TYPES[schema['type']]} {limits}".strip()


def number(value: float) -> str:
    return "2⁶³" if value == 2**63 else f"{value:,}" if float(value).is_integer() else f"{value:g}"


def rows() -> list[str]:
    """The first three columns of the table, in the order of the schema."""
    out = []

    def add(prefix: str, section: type[BaseModel]) -> None:
        properties = section.model_json_schema()["properties"]
        for name, field in section.model_fields.items():
            if section is ModelSection and name in ModelTable.model_fields:  # of a declared model, on a page of its own
                continue
            if name == "cell":  # which a sweep writes
                continue
            if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
                add(name if prefix == "group.NAME" else f"{prefix}.{name}", field.annotation)
                continue
            value = field.default
            default = "required" if value is PydanticUndefined else f"`{json.dumps(value)}`"
            default = "not set" if value is None else default
            out.append(f"| `{prefix}.{name}` | {default} | {allowed(properties[name])} |")

    add("study", StudySection)
    add("group.NAME", Group)
    return out


def test_every_field_stands_in_the_table_as_the_schema_has_it() -> None:
    page = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    missing = [row for row in rows() if not any(line.startswith(row) for line in page)]
    assert not missing, "pipelines/README.md lacks rows that begin:\n" + "\n".join(missing)


def test_the_table_holds_no_field_that_is_gone() -> None:
    fields = re.findall(r"^\| `([a-zA-Z_.]+\.\w+)` \|.*\|.*\|.*\|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    known = {row.split("`")[1] for row in rows()}
    studies = {path.name for path in PAGE.parent.glob("*.toml")}
    assert set(fields) - known - studies == set()


def test_every_key_of_a_declared_model_stands_in_its_table() -> None:
    page = (PAGE.parent / "examples" / "own_model.md").read_text(encoding="utf-8")
    for name in ModelTable.model_fields.keys() - {"name", "description", "provenance"}:
        assert re.search(rf"^\| .*`{name}`.* \|", page, re.MULTILINE), name


def test_every_pipeline_is_listed_and_every_study_can_be_read() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for path in PAGE.parent.glob("*.toml"):
        assert f"| `{path.name}` |" in text, path.name
        if "study" in tomllib.loads(path.read_text(encoding="utf-8")):
            assert read_study(path).fits > 0
