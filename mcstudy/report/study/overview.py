"""What a study asked and what came out, in figures: the first thing on its page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from markupsafe import Markup

from mcstudy.analysis.correlation import correlation
from mcstudy.analysis.publications.verdict_names import AGREES, CANNOT_TELL
from mcstudy.analysis.show.answer import finding
from mcstudy.analysis.show.missed_minimum import missed_words
from mcstudy.analysis.view import GroupView
from mcstudy.fitting.certainty import MISSED
from mcstudy.models.quantities import sums
from mcstudy.report.figures.common import chosen_fmax
from mcstudy.report.html import paragraphs, tiles
from mcstudy.report.labels import amplitude_label, cell_label, fmax_label
from mcstudy.report.study.context import Context, largest_amplitude, stat, value_of, with_ends
from mcstudy.text_tables import counted, number, with_error

Tile = tuple[str, str, str, str]
"""What, number, remark, id of the figure or section with more."""


def overview(context: Context) -> Markup:
    """The finding, the question, and a tile for each main result."""
    return paragraphs([finding(context.data), _question(context)]) + tiles(_tiles(context))


def _question(context: Context) -> str:
    view, groups = context.main, context.study.groups.values()
    g, segments = view.group, view.model.name.replace("_", "-")
    fits = sum(n for name in context.study.groups for n in _fits_run(context, name))
    kind = "" if g.model.declared else f" ({g.stimulus.kind.replace('_', ' ')})"
    return (
        f"Asked: how well do frequency responses to one stimulus{kind} identify the "
        f"{len(view.model.names)} parameters of the {segments} model? {fits:,} fits in {len(groups)} "
        f"group{'s' * (len(groups) > 1)}; group {view.name}: {counted(g.realizations, 'realization')} × "
        f"{g.starts_in_words}, Fmax {_listed(g.fmax)} Hz, "
        f"stimulus {', '.join(amplitude_label(view, a) for a in g.amplitude)}."
    )


def _fits_run(context: Context, group: str) -> list[int]:
    """Fits of a group by status, of those that are to be run."""
    return [n for status, n in context.data["groups"][group]["fits"].items() if status != "not_needed"]


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)


def _tiles(context: Context) -> list[Tile]:
    out = []
    if error := context.counterpart("largest_error"):
        remark = f"paper {error['paper_text']} %; one stimulus identifies every parameter"
        out.append(("Largest error without noise", f"{number(error['value'], 2)} %", remark, "responses"))
    view = context.accuracy
    if view is not None:
        out += _accuracy(context, view)
    judged = [r["verdict"] for r in context.published.values() if r["verdict"]]
    if judged:
        decided = [v for v in judged if v != CANNOT_TELL]
        remark = f"{len(judged) - len(decided)} more cannot be decided with studies of so few realizations."
        agreeing = f"{decided.count(AGREES)} of {len(decided)}"
        out.append(("Published statements that agree", agreeing, remark, "published"))
    return out


def _accuracy(context: Context, view: GroupView) -> list[Tile]:
    amplitude = largest_amplitude(view)
    cells = [c for c in context.cells(view) if c["amplitude"] == amplitude]
    at = amplitude_label(view, amplitude)
    out = [_bias(context, c, at) for c in _ends_and_middle(cells, chosen_fmax(view))]
    spread = [c for c in cells if c["mean_spread_percent"]["value"] is not None]
    if len(spread) > 1:
        best = min(spread, key=lambda c: c["mean_spread_percent"]["value"])
        remark = f"mean SD {stat(best['mean_spread_percent'])} % of the truth, {at}."
        out.append(("Smallest scatter at", f"Fmax {fmax_label(best['fmax'])}", remark, "estimates"))
    f = chosen_fmax(view)
    pairs = [members for members in sums(view.model).values() if len(members) == 2]
    if pairs:
        first, second = pairs[0]
        r = correlation(view.cells.sel(amplitude=amplitude, fmax=f)).sel(parameter=first, parameter_2=second)
        remark = f"of estimates, {cell_label(view, amplitude, f)}; near −1 only their sum is determined."
        out.append((f"Correlation of {first} and {second}", value_of(r), remark, "pairs"))
    needed = next((c for c in cells if c["fmax"] == f and c.get("starts_needed_median", {}).get("value")), None)
    if needed and view.group.starts > 1:
        median, many = (needed[f"starts_needed_{quantile}"] for quantile in ("median", "90th"))
        remark = f"median; {with_ends(many)} or more in one of ten realizations; {at}, {f:g} Hz."
        if needed["missed_minimum"]["value"] is not None:
            remark += f" {MISSED[0].upper()}{MISSED[1:]}: {missed_words(needed)} % (mean)."
        out.append(("Starts for 95 % certainty", with_ends(median), remark, "starts"))
    return out


def _bias(context: Context, cell: dict[str, Any], at: str) -> Tile:
    """The paper's number is a mean over amplitudes; where there is none, ours is that of one amplitude."""
    row = context.counterpart("bias", cell["fmax"])
    value = row or cell["mean_absolute_bias_percent"]
    paper = f"paper {row['paper_text']} %, " if row else f"{at}, "
    title = f"Mean |bias|, Fmax {fmax_label(cell['fmax'])}"
    floor = number(value["floor"], 2)
    return title, f"{with_error(value['value'], value['mcse'])} %", f"{paper}{floor} % expected from chance.", "bias"


def _ends_and_middle(cells: list[dict[str, Any]], fmax: float) -> list[dict[str, Any]]:
    kept = {cells[0]["fmax"], fmax, cells[-1]["fmax"]} if cells else set()
    return [c for c in cells if c["fmax"] in kept]
