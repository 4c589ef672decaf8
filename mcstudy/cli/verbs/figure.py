"""``mcstudy figure``: one figure of a results cube as a picture for a paper or a talk, or its numbers as CSV."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_cube_argument, add_out_argument
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "pages"


def add_arguments(parser: Parser) -> None:
    """Arguments of the verb."""
    add_cube_argument(parser)
    parser.add_argument("name", nargs="?", help="figure; without it, all are listed")
    add_out_argument(
        parser, "FILE", "picture (.svg, .png, .pdf) or its numbers (.csv); default NAME.png", dest="output"
    )
    parser.add_argument("--style", choices=("page", "paper", "talk"), default="page", help="size of text and lines")
    parser.add_argument("--width", type=width, metavar="MM", help="width, e.g. 85mm; default 85 (paper), 280 (talk)")
    parser.add_argument("--dpi", type=float, default=300.0, help="dots per inch of a .png; default 300")


def width(given: str) -> float:
    """Millimetres, from a number or ``85mm``, ``8.5cm``, ``3.3in``; raises `ValueError`, which argparse reports."""
    factors = {"mm": 1.0, "cm": 10.0, "in": 25.4}
    value = float(given[:-2]) * factors[given[-2:]] if given[-2:] in factors else float(given)
    if not 20.0 <= value <= 2000.0:
        raise ValueError("expected 20 to 2000 mm")
    return value


def main(args: argparse.Namespace) -> Exit:
    """Draw, or list; returns the exit code."""
    from mcstudy.cli.figure_file import UNDATED, check_figure, check_name, write_figure

    file = args.output or Path(f"{args.name}.png")
    check_figure(None, file)
    check_name(file, (*UNDATED, ".csv"))
    from mcstudy.report.study.single import drawn_alone, numbers_of, one_figure

    if args.name is None:
        return _list(args.out)
    content = one_figure(args.out, args.name)
    if file.suffix == ".csv":
        from mcstudy.files.output import write_file

        write_file(file, lambda: numbers_of(content).encode())
    else:
        write_figure(drawn_alone(content, args.style, args.width), file, args.dpi)
    print(f"{file}: {content.title}")
    return Exit.DONE


def _list(cube: Path) -> Exit:
    from mcstudy.report.study.single import all_figures
    from mcstudy.text_tables import table

    drawn, missing = all_figures(cube)
    rows = [[name, item.title] for name, item in drawn.items()]
    print(table(["figure", "what it shows"], rows, of_text=True))
    for name, why in missing.items():
        print(f"not drawn: {name}: {why}")
    return Exit.DONE
