"""The first screen of ``show``: what the experiment determines, how well, and from how many starts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from mcstudy.analysis.determined import DETERMINED, LOST, determined, lost
from mcstudy.analysis.publications.publication import cited
from mcstudy.analysis.publications.verdict_names import AGREES, CANNOT_TELL
from mcstudy.analysis.show import first_notes
from mcstudy.analysis.show.sweeps import sweep_text, sweeps_of
from mcstudy.analysis.show.text import (
    condition,
    entry_with_error,
    incomplete,
    percent_of_truth,
    share_on_bounds,
    starts_needed,
)
from mcstudy.stance.provenance import in_short
from mcstudy.text_tables import fill, folded, number, table

Entry = dict[str, Any]
"""A group, a cell, or a parameter of a cell, of the tables."""

LISTED = 8
"""Most names in a list, and conditions of one kind, of the first screen."""


def answer(data: Entry) -> str:
    """The first screen, of about twenty lines with a dozen parameters."""
    if all("cell" in group for group in data["groups"].values()):
        return _of_sweeps(data)
    name = main_group(data)
    group = data["groups"][name]
    found = [fill(finding(data)), *_of_noise(group)] if group["design"]["noise"] else _without_noise(name, group)
    warnings = [note for g in data["groups"].values() for note in first_notes(g)]
    parts = [_head(data), *map(fill, [*filter(None, [incomplete(data)]), *dict.fromkeys(warnings)]), *found]
    return folded("\n".join([*parts, *_publication(data), _further(data, name)]))


def _of_sweeps(data: Entry) -> str:
    """The first screen of a study that is nothing but sweeps."""
    tables = [sweep_text(name, cells) for name, cells in sweeps_of(data["groups"]).items()]
    return folded("\n\n".join(["\n".join([_head(data), *filter(None, [incomplete(data)])]), *tables]))


def main_group(data: Entry) -> str:
    """The group that answers: one with noise, then of most conditions and realizations."""

    def size(name: str) -> tuple[bool, int]:
        design = data["groups"][name]["design"]
        return bool(design["noise"]), len(data["groups"][name]["cells"]) * int(design["realizations"])

    return max((name for name, g in data["groups"].items() if "cell" not in g), key=size)


def best(cells: list[Entry]) -> Entry:
    """The condition whose estimates are nearest to the truth: least mean of their relative RMS errors."""

    def error(cell: Entry) -> float:
        known = [p for p in cell["parameters"] if p["truth"] and p["rmse"]["value"] is not None]
        return sum(p["rmse"]["value"] / abs(p["truth"]) for p in known) / len(known) if known else math.inf

    return min(cells, key=error)


def _fitted(cell: Entry) -> list[Entry]:
    """The parameters of the fit, without the quantities that follow from them."""
    return [p for p in cell["parameters"] if share_on_bounds(p) is not None] or cell["parameters"]


def _score(cell: Entry) -> str:
    fitted = _fitted(cell)
    return f"{_count(fitted)} of {len(fitted)}"


def _count(parameters: list[Entry]) -> int:
    """How many are determined."""
    return sum(determined(*_held(p)) for p in parameters)


def _held(parameter: Entry) -> tuple[float | None, float]:
    """CV, and share of the estimates on a bound."""
    return parameter["cv"]["value"], share_on_bounds(parameter) or 0.0


def _head(data: Entry) -> str:
    groups = data["groups"].values()
    fits = sum(n for group in groups for kind, n in group["fits"].items() if kind not in ("pending", "not_needed"))
    truths = "; ".join(dict.fromkeys(in_short(group["truth_provenance"]) for group in groups))
    models = ", ".join(dict.fromkeys(group["design"]["model"] for group in groups))
    return fill(f"{data['study']['title']}: {fits:,} fits of {models} (true values: {truths})")


def finding(data: Entry) -> str:
    """What the best condition determines, in one sentence; empty where no group of its own has noise."""
    if all("cell" in group for group in data["groups"].values()):
        return ""
    name = main_group(data)
    group = data["groups"][name]
    design, cells = group["design"], group["cells"]
    if not design["noise"]:
        return ""
    cell = best(cells)
    named = f"group {name}, " if len(data["groups"]) > 1 else ""
    which = f" ({named}the best of {len(cells)} conditions)" if len(cells) > 1 else ""
    bias, spread = cell["mean_absolute_bias_percent"], cell["mean_spread_percent"]
    return (
        f"At {condition(cell, design)}{which} {_score(cell)} parameters are determined (CV below "
        f"{100 * DETERMINED:.0f} %): mean |bias| {entry_with_error(bias)} % (chance alone "
        f"{number(bias['floor'], 2)}), mean SD {number(spread['value'], 2)} %."
    )


def _of_noise(group: Entry) -> Iterator[str]:
    design, cells = group["design"], group["cells"]
    cell = best(cells)
    yield f"\n{_parameters(cell)}"
    missing = [_why(p) for p in cell["parameters"] if lost(*_held(p))]
    if missing:
        yield fill(f"Not determined: {_listed(missing)}.", "  ")
    yield fill(f"Starts needed in 9 of 10 realizations: {_starts(cell, cells)}.", "  ")
    if share := cell["unstable"]["value"]:
        yield f"Unstable loops: {100 * share:.0f} % of best fits."
    if len(cells) > 1:
        yield fill(f"{_by_fmax(cells, design)}.", "  ")


def _parameters(cell: Entry) -> str:
    """Bias with its Monte Carlo error and CV of every parameter, two in a row."""
    entries = [[p["name"], entry_with_error(p["bias"], percent_of_truth(p)), _cv(p)] for p in cell["parameters"]]
    half = math.ceil(len(entries) / 2)
    rows = [[*entries[i], *(entries[half + i] if half + i < len(entries) else [""] * 3)] for i in range(half)]
    return table(["", "bias %", "CV %"] * 2, rows, ruled=False)


def _why(parameter: Entry) -> str:
    on = share_on_bounds(parameter) or 0.0
    return f"{parameter['name']} ({f'on a bound {100 * on:.0f} %' if on >= LOST else f'CV {_cv(parameter)} %'})"


def _cv(parameter: Entry) -> str:
    cv = parameter["cv"]["value"]
    return number(None if cv is None else 100 * cv, 2)


def _listed(names: list[str]) -> str:
    more = len(names) - LISTED
    return ", ".join(names[:LISTED]) + (f" and {more} more" if more > 0 else "")


def _starts(cell: Entry, cells: list[Entry]) -> str:
    hardest = max(cells, key=lambda c: c["starts_needed_90th"]["value"] or 0.0)
    here, most = (starts_needed(c["starts_needed_90th"]) for c in (cell, hardest))
    return here if hardest is cell or here == most else f"{here}; at {hardest['fmax']:g} Hz {most}"


def _by_fmax(cells: list[Entry], design: Entry) -> str:
    """How many parameters each condition determines."""
    of = len(_fitted(cells[0]))
    counts = [
        ", ".join(str(_count(_fitted(c))) for c in cells if c["amplitude"] == amplitude)
        + f" of {of} ({amplitude:g} {design['amplitude_unit']})"
        for amplitude in design["amplitude"]
    ]
    return f"Determined at {', '.join(f'{f:g}' for f in design['fmax'])} Hz: {'; '.join(counts)}"


def _without_noise(name: str, group: Entry) -> Iterator[str]:
    """Without noise every error of a best fit is that of the optimiser, and starts are the question."""
    cells = group["cells"]
    errors = [p["absolute_bias_percent"]["value"] for cell in cells for p in cell["parameters"]]
    worst = max((e for e in errors if e is not None), default=None)
    yield fill(f"Without noise (group {name}) the largest error of a best fit is {number(worst, 2)} %.")
    for cell in cells[:LISTED]:
        yield f"  starts needed at {condition(cell, group['design'])}: {starts_needed(cell['starts_needed_90th'])}"


def _publication(data: Entry) -> Iterator[str]:
    rows = [row["verdict"] for row in data["paper"]["rows"] if row["verdict"]]
    if rows:
        told = [v for v in rows if v != CANNOT_TELL]
        agree = sum(v == AGREES for v in told)
        name = cited(data["paper"]["reference"]).name
        rest = f"{len(rows) - len(told)} are undecided (--paper)"
        yield fill(f"Statements of {name}: {agree} agree, {len(told) - agree} differ, {rest}.", "  ")


def _further(data: Entry, main: str) -> str:
    sweeps = {g.get("cell", {}).get("sweep", name): None for name, g in data["groups"].items()}
    others = [name for name in sweeps if name != main]
    lines = [f"Other groups (--group): {_listed(others)}."] if others else []
    lines.append("More: --all --starts --fmax --amplitude --parameter; page: mcstudy report OUT")
    return "\n".join(fill(line, "  ") for line in lines)
