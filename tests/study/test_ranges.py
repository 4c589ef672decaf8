"""Whatever number stands in a field of a study file: refused in one line, or the study plans, runs and shows."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

import pytest
from fuzzing import MANY
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mcstudy.analysis.show.tables import show
from mcstudy.errors import InputError
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.ranges import Range
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import Group, Study, StudySection
from mcstudy.study.execution.tasks import fill
from mcstudy.study.plan import plan_study
from mcstudy.study.study_file import parse_study

Place = tuple[str, ...]

ANY = (0.0, -1.0, 1e-300, 1e-30, 1e300, 1e308, math.nan, math.inf, -math.inf)

NAMES = {"truth": two_segment().names, "absolute": two_segment().names, "body": [f.name for f in fields(Body)]}
"""Keys of the tables that name what a model has."""


def numeric(model: type[BaseModel], at: Place = ()) -> Iterator[tuple[Place, tuple[float, ...]]]:
    """Every numeric field: its place, and the ends of what it is declared to allow."""
    for name, field in model.model_fields.items():
        place = (*at, name)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from numeric(field.annotation, place)
            continue
        kinds = list(leaves(Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation))
        for kind in kinds:
            for key in NAMES.get(name, [""]):
                yield (*place, *([key] if key else [])), kind


def leaves(annotation: Any) -> Iterator[tuple[float, ...]]:
    """The ends of the numbers inside an annotation: none for a number without declared ends, nothing for text."""
    if annotation in (int, float):
        yield ()
    elif get_origin(annotation) is Annotated:
        inner, *metadata = get_args(annotation)
        if inner in (int, float):
            yield tuple(ends(metadata))
        else:
            yield from leaves(inner)
    elif get_origin(annotation) in (tuple, dict, UnionType):
        for part in dict.fromkeys(get_args(annotation)):
            yield from leaves(part)


def ends(metadata: list[Any]) -> Iterator[float]:
    for one in metadata:
        if isinstance(one, FieldInfo):
            yield from ends(one.metadata)
        if isinstance(one, Range):
            yield from (one.low, one.high, *((-one.low, -one.high) if one.signed else ()))
        for bound in ("ge", "le"):
            if getattr(one, bound, None) is not None:
                yield getattr(one, bound)


FIELDS = [((*("study",), *place), kind) for place, kind in numeric(StudySection)] + list(numeric(Group))


def text(place: Place, value: float, **changes: Any) -> str:
    """A tiny study file with one number replaced."""
    group: dict[str, Any] = {"realizations": 2, "starts": 2, "fmax": [1.2], "amplitude": [5.0], **changes}
    head: dict[str, Any] = {"name": "odd", "seed": 1}
    tables = {"study": head, "group": {"g": group}}
    table: dict[str, Any] = head if place[0] == "study" else group
    keys = place[1:] if place[0] == "study" else place
    for key in keys[:-1]:
        table = table.setdefault(key, {})
    if keys[-1] in ("fmax", "amplitude", "exclude_hz"):
        table[keys[-1]] = [value]
    elif len(keys) > 1 and keys[-2] == "table":
        table |= {"f_hz": [1.0], "theta1": [1e-5], "theta2": [1e-5], keys[-1]: [value]}
    elif keys[-1] == "psd":
        table[keys[-1]] = [value, 7e-5]
    elif len(keys) > 1 and keys[-2] == "absolute":
        table[keys[-1]] = sorted([value, 1.0], key=lambda x: (math.isnan(x), x))
    else:
        table[keys[-1]] = value
    return "\n".join(toml("", tables))


def toml(path: str, table: dict[str, Any]) -> Iterator[str]:
    if path:
        yield f"[{path}]"
    for key, value in table.items():
        if not isinstance(value, dict):
            yield f"{key} = {value!r}".replace("'", '"')
    for key, value in table.items():
        if isinstance(value, dict):
            yield from toml(f"{path}.{key}" if path else key, value)


def whole(place: Place, value: float) -> float:
    """As a whole number where the field takes nothing else."""
    kinds = ("seed", "realizations", "starts", "stages", "cycles", "discard", "max_iterations")
    return int(value) if place[-1] in kinds and math.isfinite(value) else value


def study_of(place: Place, value: float) -> Study | None:
    """The study with that number; None when it is refused, in one line that names the field."""
    try:
        return parse_study(text(place, whole(place, value)))
    except InputError as error:
        said = str(error)
    assert "\n" not in said
    assert math.isfinite(value) or place[-1] in said
    return None


def name(case: tuple[Place, tuple[float, ...]]) -> str:
    return ".".join(case[0])


def test_every_number_declares_what_it_may_be() -> None:
    assert len(FIELDS) == 65
    open_ended = [place for place, kind in FIELDS if len(kind) < 2]
    # their ends are not among what they may be: seed < 2**63, 0 < width, 0 < tolerance, step_tolerance < 1
    assert {place[-1] for place in open_ended} == {"seed", "width", "tolerance", "step_tolerance"}


@pytest.mark.parametrize("case", FIELDS, ids=name)
def test_a_number_no_body_has_is_refused_in_one_line(case: tuple[Place, tuple[float, ...]]) -> None:
    place, kind = case
    for value in (1e300, 1e308, math.nan, math.inf, -math.inf):
        assert study_of(place, value) is None
    if kind and place[-1] not in ("seed", "discard"):
        assert study_of(place, 1e-300) is None or place[-1] in ("width", "tolerance", "step_tolerance")
    for value in (*ANY, *kind):
        study_of(place, value)


WORST = ("amplitude", "model.truth.K11", "model.body.A2", "model.bounds.absolute.K11", "noise.psd")
"""Fields whose ends once broke a table; every field is run with ``MCSTUDY_FUZZ`` set, which takes minutes."""

RUN = [case for case in FIELDS if MANY or name(case) in WORST]


@pytest.mark.parametrize("case", RUN, ids=name)
def test_a_study_at_the_ends_of_what_is_accepted_plans_runs_and_shows(
    case: tuple[Place, tuple[float, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcstudy.study.plan.PILOT_REALIZATIONS", {"spectral": 3, "time_domain": 3})
    place, kind = case
    for i, value in enumerate(dict.fromkeys((*ANY, *kind) if MANY else kind)):
        study = study_of(place, value)
        if study is None or study.fits > 1000:
            continue
        plan_study(study, allow_unstable=True)
        cube = Cube.create(tmp_path / f"{i}.zarr", study)
        for store in cube.groups.values():
            for chunk in store.layout.chunks:
                data = store.layout.empty(chunk)
                fill(store.experiment, store.layout, chunk, data)
                store.write(chunk, data)
        shown = show(cube.path)
        assert "Group g" in shown.details()
        assert shown.json()
