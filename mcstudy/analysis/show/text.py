"""The tables of ``show`` as text for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mcstudy.analysis.determined import OFTEN
from mcstudy.analysis.measures import MEASURES
from mcstudy.analysis.publications.publication import cited
from mcstudy.analysis.publications.verdict_names import AGREES, LIMIT
from mcstudy.analysis.show import first_notes
from mcstudy.analysis.show.missed_minimum import missed_words
from mcstudy.analysis.show.sweeps import sweep_text, sweeps_of
from mcstudy.analysis.statistics import CELL_STATISTICS, CellStatistic
from mcstudy.stance.provenance import another_body
from mcstudy.text_tables import counted, fill, folded, number, starts_in_words, table, with_error

_HOW = {True: "paired by realization (same noise)", False: "independent (other seed)"}


def everything(data: dict[str, Any]) -> str:
    """All tables of a `mcstudy.analysis.show.summary.show_data`."""
    study = data["study"]
    parts = [f"Study {study['title']} (seed {study['seed']}, fingerprint {str(study['fingerprint'])[:12]})"]
    parts += [fill(left)] if (left := incomplete(data)) else []
    for provenance in dict.fromkeys(g["truth_provenance"] for g in data["groups"].values()):
        parts.append(fill(f"True values: {provenance}."))
    if data["paper"]["rows"]:
        parts.append(publication(data))
    if data["comparisons"] or data["not_compared"]:
        parts.append(differences(data))
    return folded("\n\n".join([*parts, groups(data)]))


def differences(data: dict[str, Any]) -> str:
    """Groups minus their reference, and why others have none."""
    parts = [_comparisons(with_it) for with_it in _by_reference(data["comparisons"])]
    parts += [f"Group {name} is not compared: {reason}" for name, reason in data["not_compared"].items()]
    return folded("\n\n".join(parts))


def groups(data: dict[str, Any]) -> str:
    """The tables of each sweep and of each group that is in none."""
    parts = [sweep_text(name, cells) for name, cells in sweeps_of(data["groups"]).items()]
    parts += [_group(name, group) for name, group in data["groups"].items() if "cell" not in group]
    return folded("\n\n".join(parts))


def starts(data: dict[str, Any]) -> str:
    """How many starts a fit needs, in each condition of each group."""
    rows = [
        [
            f"{name}: {condition(cell, group['design'])}",
            number(cell["hit_rate"], 2),
            missed_words(cell),
            *(starts_needed(cell[f"starts_needed_{q}"]) for q in ("90th", "median")),
        ]
        for name, group in data["groups"].items()
        for cell in group["cells"]
    ]
    return folded(
        table(["", "in 9 of 10", "in half", "hit rate", "P(missed) %"], [[r[0], *r[3:], *r[1:3]] for r in rows])
        + "\n"
        + fill(
            "Starts after which 9 of 10, and half, of the realizations are 95 % sure of their lowest minimum [95 % "
            "interval; -: an end that so few realizations cannot bound]. hit rate: fraction of starts that reach it. "
            "P(missed): probability that as many new starts would all miss it."
        )
    )


def condition(cell: dict[str, Any], design: dict[str, Any]) -> str:
    """Fmax and amplitude of a cell."""
    return f"{cell['amplitude']:g} {design['amplitude_unit']}, {cell['fmax']:g} Hz"


def incomplete(data: dict[str, Any]) -> str:
    """Sentence with the number of pending fits of each group; empty when there are none."""
    fits = {name: group["fits"] for name, group in data["groups"].items()}
    left = [f"{f['pending']} of {sum(f.values())} fits of group {name}" for name, f in fits.items() if f.get("pending")]
    if not left:
        return ""
    return f"Not complete: {', '.join(left)} are pending; all numbers are from the fits that have been run."


def ours(row: dict[str, Any]) -> str:
    """Our value with its error and unit, or its range over the readings of a definition; a dash for none."""
    if row["value"] is None:
        return "-"
    unit = "" if row["unit"] in ("1", "starts") else f" {row['unit']}"
    if row["low"] is not None and row["low"] < row["high"]:
        return f"{row['low']:g} to {row['high']:g}{unit}"
    return with_error(row["value"], row["mcse"]) + unit


def verdict(row: dict[str, Any]) -> str:
    """The verdict in words, with what would settle it; a dash where the publication gives nothing to compare with."""
    limits = {"realizations": f"n = {row['needed']}", "paper's error": "paper's error", "definition": "definition"}
    limit = limits.get(row["limited_by"] or "")
    return (row["verdict"] or "-") + (f" ({limit})" if limit else "")


def within(rows: list[dict[str, Any]]) -> str:
    """How many of the rows that can be compared are within `LIMIT` errors of both studies; exact ones if they agree."""
    compared = [row for row in rows if row["verdict"]]
    near = [row["verdict"] == AGREES if row["distance"] is None else abs(row["distance"]) <= LIMIT for row in compared]
    return f"Within {LIMIT:g} standard errors of both studies: {sum(near)} of {len(near)} rows."


def comparison_title(data: dict[str, Any]) -> str:
    """Title of the comparison; it says so if a study's own true values make another body."""
    name = cited(data["paper"]["reference"]).name
    changed = any(another_body(group["truth_provenance"]) for group in data["groups"].values())
    return f"Another body compared with that of {name}" if changed else f"Comparison with {name}"


def publication(data: dict[str, Any]) -> str:
    """The comparison with a publication, statement by statement."""
    paper: dict[str, Any] = data["paper"]
    body, notes = [], []
    for row in paper["rows"]:
        mark = verdict(row)
        if row["explanation"]:
            if row["explanation"] not in notes:
                notes.append(row["explanation"])
            mark += f" [{notes.index(row['explanation']) + 1}]"
        body.append([row["label"], row["paper_text"], ours(row), number(row["distance"], 2), mark])
    lines = [
        f"{comparison_title(data)} ({paper['reference']})",
        "± is one Monte Carlo standard error (MCSE)",
        "",
        table(["", "paper", "ours ± MCSE", "z", "verdict"], body),
        "",
        within(paper["rows"]),
        *map(fill, cited(paper["reference"]).reading),
    ]
    floors = [
        f"{number(r['floor'], 2)} ({r['label'].removeprefix('mean |bias|, ')})" for r in paper["rows"] if r["floor"]
    ]
    if floors:
        chance = "Mean |bias| from chance alone (floor), of unbiased estimates with the published realizations, in %"
        lines.append(fill(f"{chance}: {'; '.join(floors)}."))
    for row in paper["rows"]:
        if row["detail"]:
            lines.append(fill(f"{row['label']}; ours: {row['detail']}", "    "))
    for i, note in enumerate(notes, 1):
        lines.append(fill(f"[{i}] {note}", "    "))
    return "\n".join(lines)


def _by_reference(comparisons: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    names = dict.fromkeys(c["reference"] for c in comparisons)
    return [[c for c in comparisons if c["reference"] == name] for name in names]


def _comparisons(all_of_them: list[dict[str, Any]]) -> str:
    reference = all_of_them[0]["reference"]
    header = (
        f"Compared with group {reference}: the other group minus {reference}, {_HOW[all_of_them[0]['paired']]}, mean "
        "over amplitudes, ± one MCSE of the difference. "
        + "; ".join(f"{m.head}: {m.meaning}" for m in MEASURES.values())
        + "."
    )
    rows: list[list[str]] = []
    claims: list[str] = []
    for c in all_of_them:
        for i, cell in enumerate(c["cells"]):
            differences = [with_error(cell[k]["value"], cell[k]["mcse"]) for k in MEASURES]
            rows.append([c["group"] if i == 0 else "", f"{cell['fmax']:g} Hz", *differences])
        if c["claims"]:
            claims.append(_claims(c))
    lines = [fill(header), "", table(["", "Fmax", *(m.head for m in MEASURES.values())], rows), ""]
    for c in all_of_them:
        how_many = counted(c["realizations"], "realization")
        lines.append(fill(f"{c['group']}: {'; '.join(c['differences']) or 'same setting'}; {how_many}", "    "))
    return "\n".join([*lines, *claims])


def _claims(comparison: dict[str, Any]) -> str:
    """Published claims about one group, each statement with its verdict."""
    out, claim = [], ""
    for v in comparison["claims"]:
        if v["claim"] != claim:
            claim = v["claim"]
            out.append("\n" + fill(f"Published on {comparison['group']}: {claim} ({v['where']})"))
        head, difference = MEASURES[v["measure"]].head, with_error(v["value"], v["mcse"])
        out.append(f"    {head} {v['expected']} at {v['fmax']:g} Hz: {v['verdict']} ({difference})")
    return "\n".join(out)


def _group(name: str, group: dict[str, Any]) -> str:
    """Numbers first, settings and remarks last; a warning stands above the numbers."""
    d = group["design"]
    runs = counted(d["realizations"], "realization" if d["noise"] else "pool")
    title = f"Group {name}: {runs} of {starts_in_words(d['starts'], d.get('until_certain', False))}"
    warnings = first_notes(group)
    parts = [title, *map(fill, warnings)]
    by_fmax = [[c for c in group["cells"] if c["fmax"] == f] for f in d["fmax"]]
    if d["simulator"] == "none":  # without noise and averaging every bias is rounding
        by_fmax = []
    parts += [_parameters(d, cells) for cells in by_fmax]
    parts.append(_overview(d, group["cells"]))
    parts += [_on_bounds(d, cells) for cells in by_fmax]
    parts += [_standard_errors(d, cells) for cells in by_fmax]
    parts.append("\n".join(fill(line, "    ") for line in _remarks(group) if line not in warnings))
    return "\n\n".join(filter(None, parts))


def _remarks(group: dict[str, Any]) -> list[str]:
    """Settings, how the fits ended, and what must be known of the numbers."""
    d = group["design"]
    fits = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in group["fits"].items() if n)
    settings = (
        f"Settings: model {d['model']}, cost {d['cost']}, solver {d['solver']}, points {d['points']}, "
        f"ramp {d['ramp']}, amplitude {d['convention']}"
    )
    own = [f"Differs from the default settings in: {'; '.join(group['differences'])}"] if group["differences"] else []
    return [settings, f"Fits: {fits}", *own, *group["notes"]]


def _count(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def starts_needed(quantile: dict[str, Any]) -> str:
    """A quantile of the starts needed with its interval; - is an end that so few realizations cannot bound."""
    ends = [_count(quantile[end]) for end in ("lower", "upper")]
    return _count(quantile["value"]) + ("" if quantile["value"] is None else f" [{', '.join(ends)}]")


def _overview(design: dict[str, Any], cells: list[dict[str, Any]]) -> str:
    shown = [s for s in CELL_STATISTICS if s.head]
    rows = []
    for cell in cells:
        r = cell["realizations"]
        rows.append(
            [
                condition(cell, design),
                f"{r['used']}/{sum(r.values())}",
                *(column for s in shown for column in _columns(s, cell[s.key])),
                number(cell["hit_rate"], 2),
                missed_words(cell),
                *(starts_needed(cell[f"starts_needed_{q}"]) for q in ("median", "90th")),
            ]
        )
    heads = [head for s in shown for head in (s.head, *["floor"] * s.floor)]
    further = "".join("\n" + fill(f"{s.head}: {s.meaning}.") for s in shown if s.meaning)
    return table(["", "used", *heads, "hit rate", "P(missed) %", "starts", "90th"], rows) + (
        "\nused: realizations used. |bias|, SD: mean over parameters, % of the truth. unstable, off bounds: % of best "
        "fits that\nare unstable, that touch no bound. cost, J_NC: medians. hit rate: fraction of starts that reach "
        "the lowest cost.\nP(missed): probability that an equal number of new starts would all miss the lowest cost "
        "(mean over\nrealizations), not known better than to 1 %. starts, 90th: new starts needed for 95 % certainty, "
        "median and 90th percentile\nof realizations [95 % interval; -: an end that so few realizations cannot bound]."
        + further
    )


def _columns(statistic: CellStatistic, entry: dict[str, Any]) -> list[str]:
    value, mcse = (_scaled(entry[k], statistic.factor) for k in ("value", "mcse"))
    text = with_error(value, mcse) if statistic.error else number(value)
    return [text, *[number(_scaled(entry.get("floor"), statistic.factor), 2)] * statistic.floor]


Columns = Callable[[dict[str, Any]], list[str]]
"""The cells of one parameter at one amplitude."""


def _by_parameter(
    design: dict[str, Any],
    cells: list[dict[str, Any]],
    heads: Sequence[str],
    selected: Callable[[dict[str, Any]], bool],
    columns: Columns,
    truth: bool = False,
) -> str:
    """Rows of the parameters that are ``wanted`` at some amplitude, ``columns`` of each; empty without any.

    ``heads``: of the columns; the first names the amplitude. ``truth``: whether a column gives the true values.
    """
    rows = [
        [first["name"], *[f"{number(first['truth'])} {first['unit']}"] * truth, *(x for p in same for x in columns(p))]
        for same in zip(*(c["parameters"] for c in cells), strict=True)
        for first in [same[0]]
        if any(map(selected, same))
    ]
    first, *others = heads
    repeated = [h for c in cells for h in (f"{first} ({c['amplitude']:g} {design['amplitude_unit']})", *others)]
    return table([f"{cells[0]['fmax']:g} Hz", *["truth"] * truth, *repeated], rows) if rows else ""


def percent_of_truth(p: dict[str, Any]) -> float | None:
    """Factor from the unit of a parameter to percent of its truth."""
    return 100 / abs(p["truth"]) if p["truth"] else None


def entry_with_error(entry: dict[str, Any], scale: float | None = 1.0) -> str:
    """A number of the tables with its Monte Carlo error, both times ``scale``; a dash where there is none."""
    return with_error(*(_scaled(entry[k], scale) for k in ("value", "mcse")))


def share_on_bounds(p: dict[str, Any]) -> float | None:
    """Fraction of the estimates on a bound, where it is known."""
    bounds = [p[f"at_{side}_bound"]["value"] for side in ("lower", "upper") if f"at_{side}_bound" in p]
    return sum(bounds) if bounds and None not in bounds else None


def _parameters(design: dict[str, Any], cells: list[dict[str, Any]]) -> str:
    efficiencies = [_efficiency(p) for c in cells for p in c["parameters"]]
    efficient = set(efficiencies) != {"-"}

    def columns(p: dict[str, Any]) -> list[str]:
        on = number(_scaled(share_on_bounds(p), 100), 2)
        return [
            entry_with_error(p["bias"], percent_of_truth(p)),
            entry_with_error(p["cv"]),
            on,
            *[_efficiency(p)] * efficient,
        ]

    heads = ["bias %", "CV", "on bound %", *["efficiency"] * efficient]
    without, boxed, fixed = "-" in efficiencies, any(s.endswith(_BOX) for s in efficiencies), "fixed" in efficiencies
    shown = _by_parameter(design, cells, heads, lambda _: True, columns, truth=True)
    return shown + _NO_BOUND * (efficient and without) + _BOXED * boxed + _FIXED * fixed


def _on_bounds(design: dict[str, Any], cells: list[dict[str, Any]]) -> str:
    """Median, MAD and quantiles of the parameters of those that are often on a bound; empty if there are none."""

    def columns(p: dict[str, Any]) -> list[str]:
        ends = [number(_scaled(p[f"quantile_{q}"]["value"], percent_of_truth(p)), 3) for q in ("05", "95")]
        return [*(entry_with_error(p[key], percent_of_truth(p)) for key in ("median_bias", "mad")), " to ".join(ends)]

    heads = ["median bias %", "MAD %", "5 to 95 %"]
    shown = _by_parameter(design, cells, heads, lambda p: (share_on_bounds(p) or 0.0) >= OFTEN, columns)
    return shown and shown + (
        "\nEstimates on bounds: median bias and median absolute deviation (MAD), and 5th to 95th percentile, in % of "
        "the truth.\nWhere estimates pile up on two bounds, the mean lies where few are, and the SD is that of the box."
    )


def _scaled(x: float | None, scale: float | None) -> float | None:
    return None if x is None or scale is None else scale * x


def _standard_errors(design: dict[str, Any], cells: list[dict[str, Any]]) -> str:
    """How true the standard errors are; empty for a cube without them."""

    def columns(p: dict[str, Any]) -> list[str]:
        shares = [share_with_ends(p[key]) for key in ("coverage", "bias_eliminated_coverage")]
        return [entry_with_error(p["se_relative_error"]), *shares, _count(p["coverage"]["used"])]

    heads = ["SE off %", "holds truth %", "holds mean %", "of"]
    shown = _by_parameter(design, cells, heads, lambda p: "coverage" in p, columns)
    return shown and shown + (
        "\nStandard errors (SE) of the fits. SE off: their root mean square against the SD of the estimates. holds: "
        "share of\n95 % intervals, estimate ± 1.96 SE, that hold the truth or the mean estimate "
        "[95 % interval]. of: realizations\nwith a standard error; with the parameter on a bound there is none."
    )


def share_with_ends(fraction: dict[str, Any]) -> str:
    """A fraction in percent with its interval."""
    if fraction["value"] is None:
        return "-"
    value, low, high = (f"{100 * fraction[k]:.0f}" for k in ("value", "lower", "upper"))
    return f"{value} [{low}, {high}]"


_BOX = " b"
_NO_BOUND = "\nefficiency '-': no bound is known."
_BOXED = (
    "\nefficiency 'b': the Cramér-Rao bound does not apply (over one fit in ten is on some bound) or is not known. "
    "Given is\nthe bound of van Trees, which knows the box of allowed values, over the mean squared error."
)
_FIXED = "\nefficiency 'fixed': the bounds determine the parameter; within them, the data do not."


def _efficiency(parameter: dict[str, Any]) -> str:
    """Efficiency with error; ``fixed``: the bounds determine the parameter, so it has none; `_BOX`: see there."""
    efficiency = parameter.get("efficiency")
    if efficiency is None:
        return "-"
    if efficiency["held"]:
        return "fixed"
    if efficiency["value"] is not None or efficiency["box"] is None:
        return with_error(efficiency["value"], efficiency["mcse"])
    return with_error(efficiency["box"], efficiency["box_mcse"]) + _BOX
