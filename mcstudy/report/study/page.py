"""What stands on the page of a study, in which order."""

from __future__ import annotations

import gc
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from mcstudy.analysis.kept import Look, looking
from mcstudy.analysis.published.publication import publications
from mcstudy.analysis.results import open_for_tables
from mcstudy.analysis.show import SCHEMA
from mcstudy.analysis.show.summary import show_data
from mcstudy.analysis.show.text import incomplete, paper_title
from mcstudy.errors import InputError
from mcstudy.report.document import document
from mcstudy.report.figure import Figure, Missing, figure, missing
from mcstudy.report.html import Table, details, escape, table
from mcstudy.report.study.comparison import comparison_html
from mcstudy.report.study.context import Context
from mcstudy.report.study.estimates import (
    efficiency_figure,
    estimates,
    paper_estimate_figures,
    statistic_figures,
)
from mcstudy.report.study.model import model_html
from mcstudy.report.study.overview import overview
from mcstudy.report.study.pairs import pairs_figure
from mcstudy.report.study.search import further_search_figures, paper_search_figures
from mcstudy.report.study.signals import signal_figures
from mcstudy.report.study.standard_errors import zipper_figures
from mcstudy.report.study.tables import beside as published_beside
from mcstudy.report.study.tables import group_overviews, headline, introduction
from mcstudy.study.cube.conversion import structured


def study_page(path: Path, beside: Sequence[Path], looks: ExitStack, look: Look) -> str:
    """The page of the cube at ``path``, which ``look`` looks at; see `mcstudy.report.page.page`.

    Statistics of cubes beside it are kept when ``looks`` close.
    """
    with _rarely_collected():
        companions = [(file, _companion(file, looks)) for file in beside]
        return _page(_context(path, look), companions)


@contextmanager
def _rarely_collected() -> Iterator[None]:
    """Arrays and figures are many small objects that are needed; to look for unused ones takes a tenth of the time."""
    usual = gc.get_threshold()
    gc.set_threshold(50_000, 20, 100)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def _context(path: Path, look: Look) -> Context:
    return Context(open_for_tables(path), lambda study: look.kept(SCHEMA, [], lambda: show_data(study)))


def _companion(file: Path, looks: ExitStack) -> Context | None:
    """The study of a cube; statistics are kept when ``looks`` close. None for a file, which a publication reads."""
    return _context(file, looks.enter_context(looking(file))) if file.is_dir() else None


def _page(context: Context, companions: Sequence[tuple[Path, Context | None]]) -> str:
    sections = [section for p in publications() if (section := p.section(context, companions))]
    if companions and not sections:
        raise InputError("--beside: expected a publication that shows further results, none is installed")
    main = context.accuracy
    own = context.main.group.model.declared  # no publication says anything about such a model
    paper = paper_search_figures(context) + paper_estimate_figures(context)
    if not own:
        paper = signal_figures(context) + paper
    beyond = [pairs_figure(context), *further_search_figures(context)]
    if main is not None:
        beyond += [efficiency_figure(main), *zipper_figures(main), *statistic_figures(main)]
    if own:
        sections = []
        beyond = [f for f in (*paper, *beyond) if isinstance(f, Figure) or not f.number]
        left = incomplete(context.data)
        shown = [f if isinstance(f, Missing) else _of_no_paper(f) for f in beyond]
        told = f"<p><strong>{escape(left)}</strong></p>" if left else ""
        head = [("figures", "Figures", told + _figures(context, shown))]
    else:
        head = [
            ("paper", paper_title(context.data), headline(context)),
            ("figures", "The paper's figures from this study", _figures(context, paper)),
            ("beyond", "Beyond the paper", _figures(context, beyond)),
        ]
    parts = [
        ("model", "The model", model_html(context)),
        *head,
        ("compared", "Groups compared", _traced(comparison_html(context))),
        *_other_groups(context),
        *sections,
        ("groups", "Summary tables by group", _traced(group_overviews(context))),
        ("study", "Provenance", _provenance(context)),
    ]
    return document(
        context.name,
        introduction(context) + overview(context),
        parts,
        "± is one Monte Carlo standard error (MCSE) unless it says SD.",
    )


def _traced(content: str) -> str:
    """A section of numbers with the command that prints them."""
    how = '<p class="how">Made by <code>mcstudy show OUT</code> (<code>--json</code> for every digit)</p>'
    return content + how if content else ""


def _figures(context: Context, items: list[Figure | Missing]) -> str:
    shown = [
        figure(
            f,
            published_beside(context, f.published),
            f"mcstudy report OUT, after mcstudy run {context.name}.toml -o OUT",
        )
        for f in items
        if isinstance(f, Figure)
    ]
    return "".join(shown) + missing(f for f in items if isinstance(f, Missing))


def _other_groups(context: Context) -> list[tuple[str, str, str]]:
    out = []
    for i, view in enumerate(context.others):
        items = [*estimates(context, view, f"-{i}"), efficiency_figure(view, f"-{i}"), *zipper_figures(view, f"-{i}")]
        items += statistic_figures(view, f"-{i}")
        stripped = [f if isinstance(f, Missing) else _without_paper(f) for f in items]
        differs = "".join(f"<li>{escape(d)}</li>" for d in view.differences)
        intro = f"<p>Differs from {view.reference} in:</p><ul>{differs}</ul>" if differs else ""
        out.append((f"group-{i}", f"Group {view.name}", intro + _figures(context, stripped)))
    return out


def _without_paper(content: Figure) -> Figure:
    """The paper's numbers were compared with another group."""
    return replace(content, published=())


_OF_A_PAPER = re.compile(r"\bpaper|\bFig\.")


def _of_no_paper(content: Figure) -> Figure:
    """The same without number and sentences of a publication."""
    text = tuple(
        " ".join(s for s in re.split(r"(?<=\.) (?=[A-Z])", part) if not _OF_A_PAPER.search(s)) for part in content.text
    )
    return replace(content, number="", published=(), text=tuple(part for part in text if part))


def _provenance(context: Context) -> str:
    attributes, own = context.tree.attrs, context.main.group.model.declared
    environment = structured(attributes, "environment") or {}
    versions = environment.get("versions", {})
    rows = [
        ["fingerprint of the study", str(attributes.get("fingerprint", ""))],
        ["seed", str(attributes.get("seed", ""))],
        ["schema of the cube", str(attributes.get("schema", ""))],
        ["source of the program (SHA-256)", str(environment.get("source", ""))],
        ["machine", f"{environment.get('machine', '')} {environment.get('cpu', '')}"],
        ["versions", ", ".join(f"{k} {v}" for k, v in versions.items())],
    ]
    compared = "" if own else "comparison with the paper, and "
    commands = "\n".join(
        [
            f"mcstudy run {context.name}.toml -o OUT    # every fit",
            "mcstudy verify OUT    # checks what is stored and recomputes a sample",
            f"mcstudy show OUT --json    # {compared}all numbers of every group",
            "mcstudy report OUT -o page.html    # this page",
            "python    # any single figure",
            ">>> import mcstudy",
            ">>> from mcstudy.report import figures",
            '>>> tree = mcstudy.open_results("OUT")',
        ]
    )
    settings = [
        [name, json.dumps(value) if not isinstance(value, str) else value, unit, where]
        for name, (value, unit, where) in context.publication.settings.items()
    ]
    variants = [[v.study, v.claim, v.where] for v in context.publication.claims]
    return (
        f"<pre><code>{escape(commands)}</code></pre>"
        + table(Table("This study", ["", ""], rows), "facts")
        + details("Study file", f"<pre><code>{escape(attributes.get('study', ''))}</code></pre>")
        + (
            ""
            if own
            else details(
                "Settings the paper states",
                table(Table("Paper's settings", ["setting", "value", "unit", "where"], settings), "facts"),
            )
            + details(
                "Claims of the paper that other study files check",
                table(Table("Further claims", ["study file", "claim", "where"], variants), "facts"),
            )
        )
    )
