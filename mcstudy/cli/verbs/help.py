"""``mcstudy help``: the pages of the documentation, from inside the package."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

IN_WHEEL = ("pipelines", "results_schema")
"""Folders of pages that `mcstudy.files.packaged` finds."""

TOPICS = {
    "words": ("cube, start, Fmax, bias, MCSE, gap: what each word means", "pipelines/docs/words.md"),
    "studies": ("every field of a study file, and what each shipped study answers", "pipelines/README.md"),
    "models": ("a model of your own: every field of a model file", "pipelines/examples/own_model.md"),
    "paper": ("reproduce the paper, figure by figure", "pipelines/reproduce.md"),
    "examples": ("two stimuli, populations, a model of your own", "pipelines/examples/README.md"),
    "statistics": ("the statistics of a results cube", "analysis/README.md"),
    "cube": ("what every array of a results cube means", "results_schema/README.md"),
    "pages": ("pages, figures, notebooks", "report/README.md"),
    "recordings": ("bring your own data: files, units, angles, checks", "recordings/README.md"),
    "parameters": ("the parameters of one person, with intervals", "identification/README.md"),
    "diagnosis": ("read a diagnosis, add an effect", "gap/README.md"),
    "challenge": ("the benchmark of the diagnosis", "pipelines/gap_challenge.md"),
    "solve": ("the cheapest design that reaches a target", "pipelines/docs/reference/solve.md"),
    "design": ("every field of a design file, and what the design does", "pipelines/docs/reference/design.md"),
    "infer": ("what the printed numbers tell about the lost Table I", "pipelines/table_one.md"),
    "cluster": ("run on a cluster", "study/CLUSTER.md"),
    "faults": ("what a study survives", "study/RELIABILITY.md"),
    "python": ("the Python interface", "API.md"),
}
"""What a topic is about, and its page below the package or one of the folders that a wheel holds inside it."""


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    parser.add_argument(
        "topic",
        nargs="*",
        help="a topic of the list, a verb, or a verb of gap (gap next); without it the topics are listed",
    )


def main(args: argparse.Namespace) -> Exit:
    """Print a page, or the list of topics; returns the exit code."""
    import difflib

    from mcstudy.cli.markdown import as_text
    from mcstudy.cli.parser import parser_of
    from mcstudy.cli.verbs import SHORT, module, verbs
    from mcstudy.errors import InputError
    from mcstudy.text_tables import fill, table

    if not args.topic:
        print(table(["topic", "about"], [(topic, about) for topic, (about, _) in TOPICS.items()], of_text=True))
        print(fill("\nmcstudy help TOPIC prints a page, mcstudy help VERB the options of a verb and its page."))
        print(fill(f"Verbs: {', '.join(verbs())}"))
        return Exit.DONE
    word, *below = ["gap", *args.topic] if args.topic[0] in SHORT else args.topic
    topic = getattr(module(word), "TOPIC", word) if word in verbs() else word
    if word not in verbs() and (below or topic not in TOPICS):
        near = ", ".join(difflib.get_close_matches(word, [*TOPICS, *verbs()], n=3))
        hint = f"similar: {near}" if near else "mcstudy help lists them"
        raise InputError(f"{' '.join(args.topic)}: expected a topic or a verb ({hint})")
    if word in verbs():
        parser = parser_of(word)
        for verb in below:
            if verb not in parser.below:
                wanted = f"one of {', '.join(parser.below)}" if parser.below else "no further word"
                raise InputError(f"{verb}: expected {wanted} after {parser.prog}")
            parser = parser.below[verb]
        print(parser.format_help())
    if topic in TOPICS and not below:
        file = page(topic)
        print(f"{as_text(file.read_text(encoding='utf-8'))}\nThis page: {file}")
    return Exit.DONE


def page(topic: str) -> Path:
    """The file of a topic's page."""
    from mcstudy.files.packaged import PACKAGE, packaged

    folder, _, rest = TOPICS[topic][1].partition("/")
    return packaged(folder) / rest if folder in IN_WHEEL else PACKAGE / folder / rest
