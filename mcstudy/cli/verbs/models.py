"""``mcstudy models``: list the models that a study may name, print one as TOML, or check one."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.exits import Exit

TOPIC = "models"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument(
        "name", nargs="?", help="print this model, e.g. to change it: mcstudy models elbow > my_model.toml; or a file"
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="check the model: its table against an independent evaluation, stability, and that every parameter counts",
    )
    parser.add_argument("--diagram", metavar="FILE.svg", type=Path, help="draw the block diagram of the model")


def main(args: argparse.Namespace) -> Exit:
    """Print; returns the exit code."""
    from math import isfinite

    from mcstudy.cli.figure_file import check_name
    from mcstudy.errors import DesignError
    from mcstudy.files.json_files import write_text
    from mcstudy.models.catalogue import describe, names, read_model, written
    from mcstudy.report.study.diagram import sketch, standalone
    from mcstudy.text_tables import counted, table

    check_name(args.diagram, (".svg",))
    if args.name is None:
        if args.check or args.diagram:
            raise DesignError("models: expected the name of a model or a file to check or to draw, got none")
        read = {name: read() for name, read in names().items()}
        print(table(["model", "what it is"], [(name, describe(name, t)) for name, t in read.items()], of_text=True))
        print('\nPrint one: mcstudy models NAME. Study one: model = "NAME" in a study file.')
        return Exit.DONE
    model = read_model(args.name)
    if args.diagram:
        write_text(args.diagram, standalone(model.model()))
    if not args.check:
        if not args.diagram:
            print(written(model), end="")
        return Exit.DONE
    from mcstudy.models.check import FREQUENCIES, check_response, check_stability

    try:
        apart, slopes = check_response(model)
        growth = check_stability(model)
    except DesignError as error:
        raise DesignError(f"{args.name}: model.{error}") from None
    size = ", ".join(
        counted(n, what)
        for n, what in ((len(model.joints), "joint"), (len(model.parameter), "parameter"), (len(model.term), "term"))
    )
    at = f"at {len(FREQUENCIES)} frequencies"
    print(f"{model.name}: {size}")
    print(f"responses: those of an independent evaluation {at} within {apart:.1g}, derivatives within {slopes:.1g}")
    print(f"stable: growth rate {growth:.3g} 1/s" if isfinite(growth) else "stable: a loop without dynamics")
    print("every parameter moves the response")
    print(sketch(model.model()))
    return Exit.DONE
