"""Extensions of a study by realizations, starts, Fmax, amplitudes or values of a sweep, and commands that make them."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mcstudy.errors import DesignError
from mcstudy.files.plain_errors import validated
from mcstudy.study.design import Group, Study
from mcstudy.study.group import Label
from mcstudy.study.study_file import parse_study
from mcstudy.study.sweep import moved
from mcstudy.text_tables import similar


@dataclass(frozen=True)
class Growth:
    """An extension of a study.

    Attributes
    ----------
    realizations, starts: new totals; None leaves them unchanged.
    fmax (Hz), amplitude (units of the stimulus): values to add; existing values change nothing.
    groups: names of the groups or sweeps to extend; empty for all.
    sweep: labels to add to axes of sweeps, by the name of the axis.
    """

    realizations: int | None = None
    starts: int | None = None
    fmax: tuple[float, ...] = ()
    amplitude: tuple[float, ...] = ()
    groups: tuple[str, ...] = ()
    sweep: tuple[tuple[str, tuple[Label, ...]], ...] = ()

    def command(self, out: Path) -> str:
        """The command that extends the cube ``out`` accordingly."""
        words = ["mcstudy", "extend", str(out)]
        for name in ("realizations", "starts"):
            total = getattr(self, name)
            words += [] if total is None else [f"--{name}", str(total)]
        for name in ("fmax", "amplitude"):
            values = getattr(self, name)
            words += [f"--{name}", *map(str, values)] if values else []
        words += [word for group in self.groups for word in ("--group", group)]
        words += [word for axis, labels in self.sweep for word in ("--sweep", f"{axis}={','.join(map(str, labels))}")]
        return shlex.join(words)


def grown_study(study: Study, growth: Growth) -> Study:
    """The larger study; raises `DesignError` if the extension is impossible or the result is no valid study."""
    known = {name: g.cell.sweep if g.cell else name for name, g in study.groups.items()}
    for name in growth.groups:
        if name not in (*known, *known.values()):
            raise DesignError(f"group: expected one of {', '.join(dict.fromkeys(known.values()))}, got {name}")
    names = [name for name, sweep in known.items() if not growth.groups or {name, sweep} & set(growth.groups)]
    groups = {name: _grown(f"group.{name}", g, growth) if name in names else g for name, g in study.groups.items()}
    for axis, labels in growth.sweep:
        groups |= _further(axis, labels, {name: groups[name] for name in groups if name in names or name not in known})
    # By way of the text of a study file, so that validity is decided in one place.
    return parse_study(study.model_copy(update={"groups": groups}).to_toml())


def _further(axis: str, labels: Iterable[Label], groups: Mapping[str, Group]) -> dict[str, Group]:
    """The cells that further labels on an axis add to the sweeps among ``groups``."""
    cells = [g for g in groups.values() if g.cell is not None]
    if not any(g.cell and axis in g.cell.at for g in cells):
        axes = dict.fromkeys(a for g in cells if g.cell for a in g.cell.at)
        near = f"{similar(axis, axes)}, expected one of {', '.join(axes)}" if axes else "; the study has no sweep"
        raise DesignError(f"sweep.{axis}: unknown axis{near}")
    added: dict[str, Group] = {}
    for cell in cells:
        if cell.cell and axis in cell.cell.at:
            made = (moved(cell, axis, label) for label in labels)
            added |= {name: validated(Group, own, f"group.{name}") for name, own in made if name not in groups}
    return added


def _grown(where: str, group: Group, growth: Growth) -> Group:
    totals = {}
    for name in ("realizations", "starts"):
        old, new = getattr(group, name), getattr(growth, name)
        totals[name] = old if new is None else new
        if totals[name] < old:
            raise DesignError(f"{where}.{name}: expected at least {old}, the number in the cube, got {new}")
    if group.fit.starts == "latin_hypercube" and totals["starts"] != group.starts:
        raise DesignError(
            f"{where}.starts: expected {group.starts}, because Latin hypercube starts depend on their number and all "
            f"would have to be fitted again (run a new study instead), got {totals['starts']}"
        )
    axes = {"fmax": growth.fmax, "amplitude": growth.amplitude}
    for name, values in axes.items():
        if not all(math.isfinite(x) for x in values):
            raise DesignError(f"{where}.{name}: expected finite numbers, got {', '.join(map(str, values))}")
    merged = {name: tuple(sorted({*getattr(group, name), *values})) for name, values in axes.items()}
    return group.model_copy(update={**totals, **merged})


def _further_labels(small: Study, large: Study) -> tuple[tuple[str, tuple[Label, ...]], ...]:
    """Labels by axis that the sweeps of ``large`` have and those of ``small`` do not."""
    held, wanted = map(_labels, (small, large))
    found = ((axis, tuple(x for x in labels if x not in held[axis])) for axis, labels in wanted.items() if axis in held)
    return tuple((axis, labels) for axis, labels in found if labels)


def _labels(study: Study) -> dict[str, dict[Label, None]]:
    out: dict[str, dict[Label, None]] = {}
    for group in study.groups.values():
        for axis, label in group.cell.at.items() if group.cell else ():
            out.setdefault(axis, {})[label] = None
    return out


def growths(small: Study, large: Study) -> list[Growth] | None:
    """Extensions that turn ``small`` into ``large``; None when no possible extension does."""
    by_group = []
    for name, new in large.groups.items():
        old = small.groups.get(name)
        if old is None:
            continue
        growth = Growth(
            new.realizations if new.realizations != old.realizations else None,
            new.starts if new.starts != old.starts else None,
            tuple(f for f in new.fmax if f not in old.fmax),
            tuple(a for a in new.amplitude if a not in old.amplitude),
        )
        if growth != Growth():
            by_group.append((name, growth))
    further = _further_labels(small, large)
    alike = {growth for _, growth in by_group}
    if len(alike) == 1 and len(by_group) == len(large.groups):
        steps = list(alike)
    else:
        steps = [
            Growth(g.realizations, g.starts, g.fmax, g.amplitude, tuple(n for n, growth in by_group if growth == g))
            for g in dict.fromkeys(growth for _, growth in by_group)
        ]
    steps += [Growth(sweep=further)] if further else []
    study = small
    try:
        for step in steps:
            study = grown_study(study, step)
    except DesignError:
        return None
    return steps if study.fingerprint == large.fingerprint else None
