"""The page: one HTML file with everything in it, that a browser without a network shows and prints."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import xarray as xr

from mcstudy.analysis.published import METHODS, VARIANTS
from mcstudy.analysis.text import number, with_error
from mcstudy.report.context import Context, short, stat
from mcstudy.report.figures.common import cell_label
from mcstudy.report.html import Figure, Missing, Table, details, escape, figure, missing, table
from mcstudy.report.sections.compare import comparison_html
from mcstudy.report.sections.estimates import efficiency_figure, estimates, paper_estimate_figures
from mcstudy.report.sections.search import further_search_figures, paper_search_figures
from mcstudy.report.sections.signals import signal_figures
from mcstudy.report.style import COLOURS, DARK
from mcstudy.study.results import open_results

MARK = {True: "yes", False: "no", None: "–"}
CLASS = {True: "yes", False: "no", None: "none"}


def page(path: str | Path) -> str:
    """The page of the cube at ``path``, complete or not; raises `StoreError` when it is not one."""
    return page_of(open_results(path))


def page_of(tree: xr.DataTree) -> str:
    """The page of an open cube."""
    context = Context(tree)
    main = context.accuracy
    paper = signal_figures(context) + paper_search_figures(context) + paper_estimate_figures(context)
    beyond = further_search_figures(context)
    if main is not None:
        beyond.append(efficiency_figure(main))
    parts = [
        ("paper", "Beside the paper", _headline(context)),
        (
            "figures",
            "The paper's figures from this study",
            _figures(context, paper),
        ),
        ("beyond", "What the paper does not show", _figures(context, beyond)),
        ("compared", "Groups compared", comparison_html(context)),
        *_other_groups(context),
        ("groups", "All groups in numbers", _groups(context)),
        ("study", "How this was made", _provenance(context)),
    ]
    parts = [part for part in parts if part[2]]
    contents = "".join(f'<li><a href="#{key}">{escape(title)}</a></li>' for key, title, _ in parts)
    body = "".join(
        f'<section id="{key}" aria-labelledby="{key}-h"><h2 id="{key}-h">{escape(title)}</h2>{content}</section>'
        for key, title, content in parts
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">'
        f"<title>{escape(context.name)} · mcstudy report</title><style>{_style()}</style></head><body>"
        '<a class="skip" href="#main">Skip to the results</a>'
        f"<header><h1>{escape(context.name)}</h1>{_introduction(context)}</header>"
        f'<nav aria-label="Contents"><ul>{contents}</ul></nav><main id="main" tabindex="-1">{body}</main>'
        "<footer><p>± is one Monte Carlo standard error (MCSE) unless it says SD.</p></footer></body></html>\n"
    )


def _style() -> str:
    def variables(palette: dict[str, str]) -> str:
        return "".join(f"--{name}:{value};" for name, value in palette.items())

    text = files("mcstudy.report").joinpath("page.css").read_text(encoding="utf-8")
    return text.replace("/* LIGHT */", variables(COLOURS)).replace("/* DARK */", variables(DARK))


def _introduction(context: Context) -> str:
    description = _study_field(context, "description")
    truths = dict.fromkeys(view.provenance for view in context.study.groups.values())
    conventions = dict.fromkeys(v.group.stimulus.convention.replace("_", " ") for v in context.study.groups.values())
    text = f"<p>{escape(description)}</p>" if description else ""
    text += "".join(f'<p class="truth"><strong>True values:</strong> {escape(t)}.</p>' for t in truths)
    return text + f"<p>Amplitudes of the stimulus are read as {escape(' and '.join(conventions))}.</p>"


def _study_field(context: Context, field: str) -> str:
    try:
        study = tomllib.loads(str(context.tree.attrs.get("study", "")))
    except tomllib.TOMLDecodeError:
        return ""
    return str(study.get("study", {}).get(field, ""))


def _headline(context: Context) -> str:
    rows = list(context.published.values())
    if not rows:
        return (
            "<p>No number of the paper is about a group like those of this study (two segments, a torque at the "
            "ankle, the paper's cost, its Fmax and amplitudes), so there is nothing to set beside it.</p>"
        )
    agree = sum(r["agrees"] is True for r in rows)
    judged = sum(r["agrees"] is not None for r in rows)
    head = "".join(
        f'<th scope="col" role="columnheader">{h}</th>' for h in ("What", "Paper", "Ours ± MCSE", "Agrees?", "Why not")
    )
    body = "".join(_headline_row(r) for r in rows)
    return (
        f"<p>{agree} of {judged} published numbers agree with ours within 3 Monte Carlo standard errors "
        f"({escape(context.data['paper']['reference'])}).</p>"
        f'<table class="stack" role="table"><caption>Paper and this study</caption><thead role="rowgroup">'
        f'<tr role="row">{head}</tr></thead><tbody role="rowgroup">{body}</tbody></table>'
        "<p>Floor: what a mean |bias| shows with no bias at all. Paper “&gt; 0” states an order of parameters; ours is "
        "the margin by which it holds. Numbers without noise agree when they are no larger than the paper's. – means "
        "that the paper gives no number. All of them: <code>mcstudy show OUT</code>.</p>"
    )


def _headline_row(row: dict[str, Any]) -> str:
    floor = f" (floor {number(row['floor'], 2)})" if row["floor"] is not None else ""
    detail = f"<br><small>{escape(row['detail'])}</small>" if row["detail"] else ""
    cells = [
        ("Paper", f"{escape(_paper(row))}<br><small>{escape(row['where'])}</small>", ""),
        ("Ours", f"{escape(_ours(row))}{escape(floor)}{detail}", ""),
        ("Agrees?", MARK[row["agrees"]], CLASS[row["agrees"]]),
        ("Why not", escape(row["explanation"]), ""),
    ]
    return (
        f'<tr role="row"><th scope="row" role="rowheader">{escape(row["label"])}</th>'
        + "".join(
            f'<td role="cell" data-label="{label}" class="{kind}">{text}</td>' if text else '<td role="cell"></td>'
            for label, text, kind in cells
        )
        + "</tr>"
    )


def _ours(row: dict[str, Any]) -> str:
    return _with_unit(with_error(row["value"], row["mcse"]), row)


def _paper(row: dict[str, Any]) -> str:
    return row["paper_text"] if row["criterion"] == "above zero" else _with_unit(row["paper_text"], row)


def _with_unit(text: str, row: dict[str, Any]) -> str:
    """The unit follows numbers only."""
    return text if row["unit"] in ("1", "starts") or not text[-1:].isdigit() else f"{text} {row['unit']}"


def _figures(context: Context, items: list[Figure | Missing]) -> str:
    shown = [
        figure(f, _beside(context, f), f"mcstudy report OUT, after mcstudy run {context.name}.toml -o OUT")
        for f in items
        if isinstance(f, Figure)
    ]
    return "".join(shown) + missing(f for f in items if isinstance(f, Missing))


def _beside(context: Context, content: Figure) -> str:
    """The paper's numbers that belong to a figure."""
    rows = [context.published[key] for key in content.published if key in context.published]
    if not rows:
        return ""
    lines = "".join(
        f"<li>{escape(r['label'])}: paper {escape(_with_unit(r['paper_text'], r))}, ours {escape(_ours(r))} "
        f'<span class="{CLASS[r["agrees"]]}">{_agreement(r["agrees"])}</span></li>'
        for r in rows
    )
    return f'<ul class="beside">{lines}</ul>'


def _agreement(agrees: bool | None) -> str:
    return {True: "agrees", False: "differs", None: "no number to compare"}[agrees]


def _other_groups(context: Context) -> list[tuple[str, str, str]]:
    out = []
    for i, view in enumerate(context.others):
        items = [*estimates(context, view, f"-{i}"), efficiency_figure(view, f"-{i}")]
        stripped = [f if isinstance(f, Missing) else _without_paper(f) for f in items]
        differs = "".join(f"<li>{escape(d)}</li>" for d in view.differences)
        intro = f"<p>Differs from the paper's setting in:</p><ul>{differs}</ul>" if differs else ""
        out.append((f"group-{i}", f"Group {view.name}", intro + _figures(context, stripped)))
    return out


def _without_paper(content: Figure) -> Figure:
    """The paper's numbers were compared with another group."""
    return replace(content, published=())


def _groups(context: Context) -> str:
    parts = []
    for name, view in context.study.groups.items():
        g, data = view.group, context.data["groups"][name]
        fits = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in data["fits"].items() if n)
        what = "realizations" if view.noisy else "pools of starts"
        header = ["condition", "used", "mean |bias| (%)", "floor", "mean SD (%)", "unstable (%)", "off all bounds (%)"]
        rows = [
            [
                cell_label(view, c["amplitude"], c["fmax"]),
                f"{c['realizations']['used']}/{sum(c['realizations'].values())}",
                stat(c["mean_absolute_bias_percent"]),
                short(c["mean_absolute_bias_percent"]["floor"] or float("nan"), 2),
                stat(c["mean_spread_percent"]),
                stat(c["unstable"], 100.0),
                stat(c["inside_bounds"], 100.0),
            ]
            for c in data["cells"]
        ]
        parts.append(
            f"<h3>{escape(name)}</h3><p>{g.realizations} {what} × {g.starts} starts; model {escape(g.model.kind)}, "
            f"cost {escape(g.fit.cost)}, solver {escape(g.fit.solver)}. Fits: {escape(fits)}.</p>"
            + table(Table(f"Group {name}: best fits, ± MCSE", header, rows))
            + (
                "<p>Differs from the paper's setting in: " + escape("; ".join(view.differences)) + ".</p>"
                if view.differences
                else ""
            )
        )
    return "".join(parts)


def _provenance(context: Context) -> str:
    attributes = context.tree.attrs
    environment = attributes.get("environment", {})
    versions = environment.get("versions", {})
    rows = [
        ["fingerprint of the study", str(attributes.get("fingerprint", ""))],
        ["seed", str(attributes.get("seed", ""))],
        ["schema of the cube", str(attributes.get("schema", ""))],
        ["source of the program (SHA-256)", str(environment.get("source", ""))],
        ["machine", f"{environment.get('machine', '')} {environment.get('cpu', '')}"],
        ["versions", ", ".join(f"{k} {v}" for k, v in versions.items())],
    ]
    commands = "\n".join(
        [
            f"mcstudy run {context.name}.toml -o OUT    # every fit",
            "mcstudy verify OUT    # checks what is stored and recomputes a sample",
            "mcstudy show OUT --json    # every number on this page",
            "mcstudy report OUT -o page.html    # this page",
        ]
    )
    settings = [
        [name, json.dumps(value) if not isinstance(value, str) else value, unit, where]
        for name, (value, unit, where) in METHODS.items()
    ]
    variants = [[v.study, v.claim, v.where] for v in VARIANTS]
    return (
        f"<pre><code>{escape(commands)}</code></pre>"
        + table(Table("This study", ["", ""], rows), "facts")
        + details("Study file", f"<pre><code>{escape(attributes.get('study', ''))}</code></pre>")
        + details(
            "Settings the paper states",
            table(Table("Paper's settings", ["setting", "value", "unit", "where"], settings), "facts"),
        )
        + details(
            "Claims of the paper that other study files check",
            table(Table("Further claims", ["study file", "claim", "where"], variants), "facts"),
        )
    )
