"""What publications say about a study, side by side with it: python pipelines/validation/published.py pasma2017

Runs a study of ``pipelines``, shortened to one fit a group, and prints the statements about its models as the page of
the study lays them out; statements about its estimates need the whole study (`mcstudy show`).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import mcstudy as mc
from mcstudy.analysis.publications.verdict_names import AGREES
from mcstudy.report.study.context import Context
from pipelines import measured

FOLDER = Path(__file__).parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", help="name of a shipped study")
    measured.add_option(parser)
    args = parser.parse_args()
    study = mc.read_study(FOLDER / f"{args.study}.toml")
    fits = {"realizations": 1, "starts": 1}
    short = mc.Study(study=study.study, group={n: {**g.model_dump(), **fits} for n, g in study.groups.items()})
    with TemporaryDirectory() as folder:
        context = Context(mc.run(short, Path(folder) / "one.zarr"))
        rows = context.published
    laid_out = context.publication.table(rows)
    if laid_out is None:
        raise SystemExit(f"{args.study}: no publication lays out statements about it")
    print(laid_out.text(titled=True))
    agree = sum(row["verdict"] == AGREES for row in rows.values())
    values = {"statements": {"value": len(rows)}, "agree": {"value": agree}}
    measured.write(args.json, values, {"statements": (laid_out.header, laid_out.rows)})


if __name__ == "__main__":
    main()
