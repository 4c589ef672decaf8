"""What the page of a study shows, in which order."""

from __future__ import annotations

import gc
import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from markupsafe import Markup

from mcstudy.analysis.cache import Look, looking
from mcstudy.analysis.publications.publication import ALONE, publications
from mcstudy.analysis.show.text import comparison_title
from mcstudy.errors import InputError
from mcstudy.report.document import Section, document
from mcstudy.report.figure import Figure, Missing, figure, missing
from mcstudy.report.html import code, details, html, joined, table
from mcstudy.report.study.comparison import comparison_html
from mcstudy.report.study.context import Context, context_of
from mcstudy.report.study.items import group_figures, main_figures
from mcstudy.report.study.model import model_html
from mcstudy.report.study.overview import overview
from mcstudy.report.study.sweeps import sweep_figures
from mcstudy.report.study.tables import group_overviews, headline, introduction, published_beside
from mcstudy.study.cube.conversion import structured
from mcstudy.text_tables import Table


def study_page(path: Path, beside: Sequence[Path], looks: ExitStack, look: Look) -> str:
    """The page of the cube at ``path``, which ``look`` looks at; see `mcstudy.report.page.page`.

    Statistics of cubes beside it are kept when ``looks`` close.
    """
    with _rarely_collected():
        companions = [(file, _companion(file, looks)) for file in beside]
        return _page(context_of(path, look), companions)


@contextmanager
def _rarely_collected() -> Iterator[None]:
    """Arrays and figures are many small objects that are needed; to look for unused ones takes a tenth of the time."""
    usual = gc.get_threshold()
    gc.set_threshold(50_000, 20, 100)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def _companion(file: Path, looks: ExitStack) -> Context | None:
    """The study of a cube; statistics are kept when ``looks`` close. None for a file, which a publication reads."""
    return context_of(file, looks.enter_context(looking(file))) if file.is_dir() else None


def _page(context: Context, companions: Sequence[tuple[Path, Context | None]]) -> str:
    relevant = [p for p in publications() if companions or p is context.publication]
    sections = [section for p in relevant if (section := p.section(context, companions))]
    if companions and not sections:
        raise InputError("--beside: expected a publication that shows further results, none is installed")
    parts = [
        *_main_figures(context),
        ("model", "The model", model_html(context)),
        ("published", comparison_title(context.data), headline(context)),
        ("compared", "Groups compared", _traced(comparison_html(context))),
        *_other_groups(context),
        *[(f.key, f.title, _figures(context, [f])) for f in sweep_figures(context)],
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


def _traced(content: Markup) -> Markup:
    """A section of numbers with the command that prints them."""
    how = '<p class="how">Made by <code>mcstudy show OUT</code> (<code>--json</code> for every digit)</p>'
    return content and content + Markup(how)


def _main_figures(context: Context) -> list[Section]:
    """Figures of the study: those that the publication has too, and the others."""
    items, publication = main_figures(context), context.publication
    first, *items = items
    top = ("tells", first.title, _figures(context, [first]))
    numbered = [f for f in items if publication.counterparts.get(f.key, ALONE).number]
    if not numbered:
        return [top, ("figures", "Figures", _figures(context, items))]
    name = publication.name
    others = [f for f in items if f not in numbered]
    return [
        top,
        ("figures", f"{name[0].upper()}{name[1:]}'s figures from this study", _figures(context, numbered)),
        ("beyond", f"Beyond {name}", _figures(context, others)),
    ]


def _figures(context: Context, items: Sequence[Figure | Missing]) -> Markup:
    """Figures, each with what the publication has of it."""
    counterparts = context.publication.counterparts
    made = f"mcstudy report OUT, after mcstudy run {context.name}.toml -o OUT"
    shown = joined(
        figure(f, made, counterpart, published_beside(context, counterpart.rows))
        for f in items
        if isinstance(f, Figure)
        for counterpart in [counterparts.get(f.key, ALONE)]
    )
    return shown + missing([f for f in items if isinstance(f, Missing)], counterparts)


def _other_groups(context: Context) -> list[Section]:
    out = []
    for i, (view, items) in enumerate(group_figures(context)):
        differs = joined(html("<li>{}</li>", d) for d in view.differences)
        intro = differs and html("<p>Differs from the default settings in:</p><ul>{}</ul>", differs)
        out.append((f"group-{i}", f"Group {view.name}", intro + _figures(context, items)))
    return out


def _provenance(context: Context) -> Markup:
    attributes, publication = context.tree.attrs, context.publication
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
    settings = [
        [name, value if isinstance(value, str) else json.dumps(value), unit, where]
        for name, (value, unit, where) in publication.settings.items()
    ]
    claims = [[v.study, v.claim, v.where] for v in publication.claims]
    published = [
        ("Published settings", Table("Settings", ["setting", "value", "unit", "where"], settings)),
        ("Published claims that other study files check", Table("Claims", ["study file", "claim", "where"], claims)),
    ]
    return (
        code(
            f"mcstudy run {context.name}.toml -o OUT    # every fit",
            "mcstudy verify OUT    # checks what is stored and recomputes a sample",
            "mcstudy show OUT --json    # all numbers of every group",
            "mcstudy report OUT -o page.html    # this page",
            "python    # any single figure",
            ">>> import mcstudy",
            ">>> from mcstudy.report import figures",
            '>>> tree = mcstudy.open_results("OUT")',
        )
        + table(Table("This study", ["", ""], rows), "facts")
        + details("Study file", code(str(attributes.get("study", ""))))
        + joined(details(summary, table(content, "facts")) for summary, content in published if content.rows)
    )
