"""Extensions of a study by realizations, starts, Fmax values or amplitudes, and the commands that make them."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from mcstudy.errors import DesignError
from mcstudy.study.design import Group, Study
from mcstudy.study.study_file import parse_study


@dataclass(frozen=True)
class Growth:
    """An extension of a study.

    Attributes
    ----------
    realizations, starts: new totals; None leaves them unchanged.
    fmax (Hz), amplitude (units of the stimulus): values to add; existing values change nothing.
    groups: names of the groups to extend; empty for all.
    """

    realizations: int | None = None
    starts: int | None = None
    fmax: tuple[float, ...] = ()
    amplitude: tuple[float, ...] = ()
    groups: tuple[str, ...] = ()

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
        return shlex.join(words)


def grown_study(study: Study, growth: Growth) -> Study:
    """The larger study; raises `DesignError` if the extension is impossible or the result is no valid study."""
    for name in growth.groups:
        if name not in study.groups:
            raise DesignError(f"group: expected one of {', '.join(study.groups)}, got {name}")
    names = growth.groups or tuple(study.groups)
    groups = {name: _grown(f"group.{name}", g, growth) if name in names else g for name, g in study.groups.items()}
    # By way of the text of a study file, so that validity is decided in one place.
    return parse_study(study.model_copy(update={"groups": groups}).to_toml())


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


def growths(small: Study, large: Study) -> list[Growth] | None:
    """Extensions that turn ``small`` into ``large``; None when no possible extension does."""
    by_group = []
    for name, new in large.groups.items():
        old = small.groups.get(name)
        if old is None:
            return None
        growth = Growth(
            new.realizations if new.realizations != old.realizations else None,
            new.starts if new.starts != old.starts else None,
            tuple(f for f in new.fmax if f not in old.fmax),
            tuple(a for a in new.amplitude if a not in old.amplitude),
        )
        if growth != Growth():
            by_group.append((name, growth))
    alike = {growth for _, growth in by_group}
    if len(alike) == 1 and len(by_group) == len(large.groups):
        steps = list(alike)
    else:
        steps = [
            Growth(g.realizations, g.starts, g.fmax, g.amplitude, tuple(n for n, growth in by_group if growth == g))
            for g in dict.fromkeys(growth for _, growth in by_group)
        ]
    study = small
    try:
        for step in steps:
            study = grown_study(study, step)
    except DesignError:
        return None
    return steps if study.fingerprint == large.fingerprint else None
