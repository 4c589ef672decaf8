"""Settings as axes: a table ``[group.NAME.sweep]`` becomes one group for each combination of its values.

Every cell of a sweep is an ordinary group with all its settings written out, and a label that says where on the axes it
lies. So a cell is run, resumed, extended, verified and replayed like any group, and the store knows nothing of sweeps;
who opens a cube gets the cells of a sweep as one array with the axes as dimensions (`mcstudy.analysis.sweeps`). Random
streams are keyed by seed and realization, not by group: all cells share the noise of a realization, and differences
along an axis are paired.

An axis is a setting of the group (``"stimulus.cycles"``, or ``cycles`` where one setting has this name) with a list of
values, or with a table of labelled values; or any name with a table of labelled tables of settings. ``effect`` is an
axis of effects of the library, each alone in the body, beside an axis of its ``size`` (numbers, or words of its usual
range) or of its detectability ``delta``.
"""

from __future__ import annotations

import copy
import hashlib
import itertools
import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from pydantic import BaseModel

from mcstudy.errors import DesignError
from mcstudy.files.plain_errors import short, shown
from mcstudy.study.effects import DELTA, declared
from mcstudy.study.group import SECTIONS, Group, Label
from mcstudy.text_tables import similar

SWEEP = "sweep"
SKIP = "skip"
EFFECT, SIZE = "effect", "size"
USUAL = {"low": 0.0, "middle": 0.5, "high": 1.0}
"""Words for sizes: the ends and the middle of the usual range of an effect."""

LABEL = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,31}")
MOST_CELLS = 900
LONGEST = 64
"""Length of the name of a group."""

Cells = dict[str, dict[str, Any]]

_OWN_AXES = ("realizations", "starts", "most_starts", "fmax", "amplitude", "cell")
"""Settings that are no axis of a sweep: every group has them as axes of its own, or needs them alike in all cells."""

_TAKEN = (
    *("amplitude", "fmax", "realization", "start", "parameter", "angle", "angle_2", "frequency", "stimulus", "truth"),
    *("lower", "upper", "cost", "status", "initial", "estimate", "iterations", "noise_covariance", "at_bound"),
    *("growth_rate", "standard_error", "cell", "value", "n", "mcse"),
)
"""Names that the arrays and statistics of a cube have."""


@cache
def settings() -> tuple[str, ...]:
    """Every setting that may be an axis, ``section.key``; of tables with free keys the table."""
    fields = Group.model_fields
    every = (p for section in SECTIONS for p in (section, *_paths(fields[section].annotation, section)))
    return ("simulator", *(path for path in every if path != "model.kind"))


def _paths(section: Any, path: str) -> Iterator[str]:
    for name, field in section.model_fields.items():
        yield f"{path}.{name}"
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from _paths(field.annotation, f"{path}.{name}")


def expanded(name: str, fields: Mapping[str, Any]) -> Cells:
    """The groups of a table ``[group.NAME]``: itself without a sweep, else one for every combination of its axes.

    Raises `DesignError`, which starts with the field, for an axis that is none.
    """
    if SWEEP not in fields:
        return {name: dict(fields)}
    sweep, where = fields[SWEEP], f"group.{shown(name)}.{SWEEP}"
    if not isinstance(sweep, Mapping) or not set(sweep) - {SKIP}:
        raise DesignError(f"{where}: expected a table of axes, got {short(sweep)}")
    plain = {key: value for key, value in fields.items() if key != SWEEP}
    axes = {key: _values(value, f"{where}.{key}") for key, value in sweep.items() if key != SKIP}
    paths = {key: _path(key, axes, f"{where}.{key}") for key in axes}
    dims = _dimensions(paths, where)
    skipped = [_skip(s, dims, f"{where}.{SKIP}") for s in _tables(sweep.get(SKIP, []), f"{where}.{SKIP}")]
    out: Cells = {}
    for chosen in itertools.product(*(values.items() for values in axes.values())):
        at = {dims[key]: label for key, (label, _) in zip(axes, chosen, strict=True)}
        if any(at.items() >= s.items() for s in skipped):
            continue
        cell = copy.deepcopy(plain)
        for key, (_, value) in zip(axes, chosen, strict=True):
            _set(cell, paths[key], value, f"{where}.{key}")
        _set_effect(cell, at, where)
        cell["cell"] = {"sweep": name, "at": at, "setting": {dims[k]: paths[k] for k in axes}}
        if (called := cell_name(name, at)) in out:
            raise DesignError(f"{where}: expected values with different names, got two called {called}")
        out[called] = cell
    if not 0 < len(out) <= MOST_CELLS:
        raise DesignError(f"{where}: expected 1 to {MOST_CELLS} cells, got {len(out)}")
    return out


def moved(cell: Group, axis: str, label: Label) -> tuple[str, dict[str, Any]]:
    """Name and fields of the cell of the same sweep at another place of one axis; raises `DesignError`."""
    assert cell.cell is not None
    section, fields, where = cell.cell, cell.model_dump(mode="json"), f"{SWEEP}.{axis}"
    path, at = section.setting[axis], {**section.at, axis: label}
    if not path and axis not in (EFFECT, SIZE, DELTA):
        raise DesignError(f"{where}: expected an axis of values, got one of named tables: run a new study")
    if axis in (EFFECT, SIZE, DELTA):
        fields["effects"]["truth"].pop(section.at[EFFECT])
    _set(fields, path, label, where)
    _set_effect(fields, at, where)
    fields["cell"]["at"] = at
    return cell_name(section.sweep, at), fields


def cell_name(sweep: str, at: Mapping[str, Label]) -> str:
    """Name of a cell's group, and of its folder: from the labels alone, so that it stays when axes grow."""
    words = [x if isinstance(x, str) else str(x).replace("-", "m").replace("+", "") for x in at.values()]
    name = "--".join([sweep, *words]).replace(".", "p")
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 9]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def _values(given: Any, where: str) -> dict[Label, Any]:
    """The values of an axis by their labels."""
    if isinstance(given, Mapping):
        labelled: dict[Label, Any] = dict(given)
    elif isinstance(given, list | tuple):
        if any(not isinstance(v, str | int | float) for v in given):
            raise DesignError(f"{where}: expected numbers or words, or a table that names other values")
        labelled = {v: v for v in given}
        if len(labelled) < len(given):
            raise DesignError(f"{where}: expected every value listed once")
    else:
        raise DesignError(f"{where}: expected a list of values or a table of named ones, got {short(given)}")
    if not labelled:
        raise DesignError(f"{where}: expected at least one value")
    for label in labelled:
        if isinstance(label, str) and not LABEL.fullmatch(label):
            raise DesignError(f"{where}: expected names of letters, digits, _, - and ., got {short(label)}")
    return labelled


def _path(key: str, axes: Mapping[str, dict[Label, Any]], where: str) -> str:
    """The setting that an axis sets; empty for effects, and for tables of settings."""
    if key in (EFFECT, SIZE, DELTA):
        return _path_of_effects(key, axes, where)
    known = settings()
    free = ("effects.truth.", "model.truth.", "model.body.", "model.bounds.absolute.")
    if key in known or key.startswith(free):
        return key
    if key in _OWN_AXES:
        raise DesignError(f"{where}: expected a setting that is no axis of a group already")
    ends = [path for path in known if path.rpartition(".")[2] == key]
    if len(ends) == 1:
        return ends[0]
    if ends:
        raise DesignError(f"{where}: expected one of {', '.join(ends)}")
    if all(isinstance(v, Mapping) for v in axes[key].values()):
        return ""
    near = similar(key, [*known, *(p.rpartition(".")[2] for p in known), EFFECT, SIZE, DELTA])
    raise DesignError(f"{where}: unknown setting{near}, expected one of a group, or {EFFECT} with {SIZE} or {DELTA}")


def _path_of_effects(key: str, axes: Mapping[str, dict[Label, Any]], where: str) -> str:
    if EFFECT not in axes or (SIZE in axes) == (DELTA in axes):
        raise DesignError(f"{where}: expected the axis {EFFECT} beside either {SIZE} or {DELTA}")
    for label, value in axes[key].items():
        if label is not value:
            raise DesignError(f"{where}: expected a list")
        if key == EFFECT:
            declared(str(value), where)
        elif isinstance(value, str) and (key == DELTA or value not in USUAL):
            words = f", or {', '.join(USUAL)}" if key == SIZE else ""
            raise DesignError(f"{where}: expected numbers{words}, got {value!r}")
    return ""


def _dimensions(paths: Mapping[str, str], where: str) -> dict[str, str]:
    """Names of the axes: the last word of the setting, with the one before where that is taken."""
    dims = {}
    for key in paths:
        words = key.split(".")
        dims[key] = words[-1] if words[-1] not in _TAKEN else "_".join(words[-2:])
        if dims[key] in _TAKEN:
            dims[key] += "_setting"
    if len(set(dims.values())) < len(dims):
        raise DesignError(f"{where}: expected axes of different names, got {', '.join(dims.values())}")
    return dims


def _tables(given: Any, where: str) -> list[Mapping[str, Any]]:
    if not isinstance(given, list) or not all(isinstance(x, Mapping) for x in given):
        raise DesignError(f"{where}: expected a list of tables, got {short(given)}")
    return given


def _skip(given: Mapping[str, Any], dims: Mapping[str, str], where: str) -> dict[str, Any]:
    """Labels of cells that are left out, by dimension."""
    for key in given:
        if key not in dims and key not in dims.values():
            raise DesignError(f"{where}.{key}: unknown axis{similar(key, dims)}, expected one of {', '.join(dims)}")
    return {dims.get(key, key): value for key, value in given.items()}


def _set(fields: dict[str, Any], path: str, value: Any, where: str) -> None:
    """Set a setting, or with an empty path all settings of a table, in place."""
    if not path:
        if isinstance(value, Mapping):
            for key, inner in value.items():
                _set(fields, key, inner, where)
        return
    *tables, last = path.split(".")
    for table in tables:
        inner = fields.get(table, {})
        if not isinstance(inner, Mapping):
            raise DesignError(f"{where}: expected {table} to be a table, got {short(inner)}")
        fields[table] = dict(inner)
        fields = fields[table]
    held = fields.get(last)
    merged = isinstance(held, Mapping) and isinstance(value, Mapping)
    fields[last] = {**held, **value} if merged else value  # type: ignore[dict-item]


def _set_effect(fields: dict[str, Any], at: Mapping[str, Label], where: str) -> None:
    """The effect of a cell on the axis `EFFECT`, alone in the body besides what the group has."""
    if EFFECT not in at:
        return
    name = str(at[EFFECT])
    size = declared(name, where).size
    low, high = size.published
    if DELTA in at:
        value: Any = {DELTA: at[DELTA]}
    else:
        label = at[SIZE]
        value = low + USUAL[label] * (high - low) if isinstance(label, str) else float(label)
    _set(fields, f"effects.truth.{name}", value, where)
