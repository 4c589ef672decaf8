"""Notes that must be read before a group's numbers: an unstable body, and missing numbers."""

from __future__ import annotations

from collections.abc import Iterator

from mcstudy.analysis.selection import inside_bounds
from mcstudy.analysis.view import GroupView
from mcstudy.study.effects import true_effects, true_sizes
from mcstudy.study.instability import warning

LEAST = 3
"""Smallest number of realizations for a Monte Carlo error."""


def notes(view: GroupView) -> list[str]:
    """One sentence per note; conditions with the same note are listed together."""
    conditions: dict[str, list[str]] = {}
    for why, cell in _of_cells(view):
        conditions.setdefault(why, []).append(cell)
    falls = [f"Warning: {warning(view.instability)}."] if view.instability else []
    return falls + _two_models(view) + [f"{why}: {'; '.join(cells)}." for why, cells in conditions.items()]


def _two_models(view: GroupView) -> list[str]:
    """What the simulated body has and the fitted model lacks, and the reverse."""
    effects = view.group.effects
    sizes = true_sizes(effects)
    missing = [
        ", ".join(f"{p} = {sizes[p]:.4g}" for p in effect.parameters)
        for name, effect in true_effects(effects).items()
        if name not in effects.fit
    ]
    extra = [name for name in effects.fit if name not in effects.truth]
    lines = [f"The simulated body has {'; '.join(missing)}, which the fitted model lacks."] if missing else []
    return lines + ([f"The fitted model has {', '.join(extra)}, which the simulated body lacks."] if extra else [])


def _of_cells(view: GroupView) -> Iterator[tuple[str, str]]:
    """Missing numbers, each with its amplitude and Fmax."""
    used = view.cells["cost"].notnull()
    on_bound = ~inside_bounds(view.cells) & used
    for fmax in view.group.fmax:
        for amplitude in view.group.amplitude:
            cell = {"amplitude": amplitude, "fmax": fmax}
            name = f"{amplitude:g} {view.model.stimulus_unit}, Fmax {fmax:g} Hz"
            n = int(used.sel(cell).sum())
            if n == 0:
                yield "No usable fit", name
                continue
            if n < LEAST:
                yield f"No Monte Carlo errors{' and no spread' * (n == 1)} from so few realizations", f"{name} ({n})"
            if view.noisy and bool(on_bound.sel(cell).sum() == n):
                yield "Every best fit ends on some bound, so the Cramér-Rao bound does not apply", name
            if view.bounds_on_sd is not None and (why := str(view.bounds_on_sd["why_not"].sel(cell).item())):
                yield f"No Cramér-Rao bound ({why})", name
            elif view.bounds_on_sd is None and view.noisy:
                yield "No Cramér-Rao bound (a noise covariance is missing or not finite)", name
