"""The JSON schemas of `results_schema`, generated from typed records: ``python -m pipelines.schemas`` writes them.

Each module declares the documents that the program writes as typed dictionaries; the schema of the results cube follows
from its layout (`pipelines.schemas.cube`). The written files are what users read and what the program validates with;
a test generates them afresh and compares. A superseded version keeps its file, which nothing generates any more.
"""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from pipelines.schemas import challenges, cube, diagnoses, models, people, recordings, studies, tables

FOLDER = Path(__file__).parents[2] / "results_schema"

DOCUMENTS: dict[str, tuple[str, type]] = {
    "status": ("1.0.0", studies.Status),
    "verification": ("1.0.0", studies.Verification),
    "solution": ("1.0.0", studies.Solution),
    "stimulus_design": ("1.0.0", studies.StimulusDesign),
    "show": ("2.0.0", tables.Show),
    "model": ("1.0.0", models.ModelFile),
    "recording": ("1.0.0", recordings.Recording),
    "alternative": ("1.0.0", recordings.Alternative),
    "fit": ("1.0.0", people.Fit),
    "conditions": ("1.0.0", people.Conditions),
    "group": ("1.0.0", people.Group),
    "comparison": ("1.0.0", people.GroupComparison),
    "diagnosis": ("1.1.0", diagnoses.Diagnosis),
    "next_trial": ("1.0.0", diagnoses.NextTrial),
    "challenge_manifest": ("1.0.0", challenges.ChallengeManifest),
    "challenge_key": ("1.0.0", challenges.ChallengeKey),
    "challenge_answers": ("1.0.0", challenges.ChallengeAnswers),
    "challenge_score": ("1.0.0", challenges.ChallengeScore),
}
"""Version and type of every document, by the name of its schema."""


PLACE = re.compile(r"`\w+` of `\w+`\.")
"""Docstring of a record that says no more than whose field it is."""


class _Untitled(GenerateJsonSchema):
    """Without titles that repeat the names of fields."""

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002
        return False


def generated() -> dict[str, str]:
    """The text of every schema, by its path below `FOLDER`."""
    documents = {f"{version}/{name}.json": document(name) for name, (version, _) in DOCUMENTS.items()}
    documents["1.0.0/study_cube.json"] = cube.schema()
    return {path: json.dumps(value, indent=1, ensure_ascii=False) + "\n" for path, value in documents.items()}


def document(name: str) -> dict[str, Any]:
    """The schema of a document, from its type; the first sentence of its docstring is the title."""
    version, kind = DOCUMENTS[name]
    whole = _tidy(TypeAdapter(kind).json_schema(schema_generator=_Untitled))
    if "$ref" in whole:  # a type that holds itself has its definition among the others
        whole |= whole["$defs"].pop(kind.__name__)
    title, _, description = " ".join((inspect.getdoc(kind) or "").split()).partition(". ")
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"mcstudy:{name}:{version}",
        "title": title.removesuffix("."),
        **({"description": description} if description else {}),
    }
    definitions = whole.pop("$defs", None)
    rest = {key: value for key, value in whole.items() if key not in head and key != "description"}
    return head | rest | ({"$defs": definitions} if definitions else {})


def _tidy(node: Any, named: bool = False) -> Any:
    """A schema in fewest words. ``named``: a mapping from names to schemas, whose keys are no keywords."""
    if isinstance(node, list):
        return [_tidy(item) for item in node]
    if not isinstance(node, dict):
        return node
    if named:
        return {key: _tidy(value) for key, value in node.items()}
    node = {
        key: _tidy(value, named=key in ("properties", "$defs", "patternProperties"))
        for key, value in node.items()
        if key != "title" and (key, value) != ("additionalProperties", True)
    }
    if "const" in node or "enum" in node:
        node.pop("type", None)
    if "description" in node:
        node["description"] = " ".join(node["description"].split())
        if PLACE.fullmatch(node["description"]):  # where it belongs, which the schema itself says
            del node["description"]
    choices = node.get("anyOf", [])
    if choices and all(isinstance(c.get("type"), str) for c in choices) and sum(len(c) > 1 for c in choices) <= 1:
        others = {key: value for key, value in node.items() if key != "anyOf"}
        node = {"type": [c["type"] for c in choices], **others}
        node |= {key: value for c in choices for key, value in c.items() if key != "type"}
    order = ("type", "description", "required", "additionalProperties", "properties")
    return {**{key: node[key] for key in order if key in node}, **node}


def write() -> list[Path]:
    """Write every schema that is not what is generated; returns the files."""
    written = []
    for path, text in generated().items():
        file = FOLDER / path
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")
            written.append(file)
    return written
