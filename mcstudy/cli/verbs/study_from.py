"""``mcstudy study-from``: write a study of the experiment in which a person was recorded."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING

from mcstudy.cli.options import add_out_argument, positive
from mcstudy.cli.recording_options import add_model_argument, add_recording_arguments, read_recordings, with_names
from mcstudy.exits import Exit

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser

TOPIC = "parameters"


def add_arguments(parser: Parser) -> None:
    """Declare the arguments."""
    add_recording_arguments(parser)
    add_model_argument(parser)
    add_out_argument(parser, "STUDY", "study file (.toml) to write", required=True)
    parser.add_argument("--realizations", type=positive, default=100, metavar="N", help="realizations (default 100)")
    parser.add_argument("--starts", type=positive, default=10, metavar="N", help="starts per fit (default 10)")


def main(args: argparse.Namespace) -> Exit:
    """Fit, write the study and say what it holds; returns the exit code."""
    from mcstudy.errors import InputError
    from mcstudy.files.json_files import write_text
    from mcstudy.identification.fit import fit
    from mcstudy.identification.settings import FitSettings
    from mcstudy.identification.study_design import study_of
    from mcstudy.scheduler.activity import activity
    from mcstudy.scheduler.compiling import PERSON, compile_kernels
    from mcstudy.text_tables import fill

    name = re.sub(r"[^A-Za-z0-9_-]", "_", args.out.stem)[:64]
    if args.out.suffix != ".toml" or not name[:1].isalpha():
        raise InputError(f"{args.out}: expected a name that begins with a letter and ends in .toml")
    read = read_recordings(args)
    compile_kernels(PERSON)
    settings = FitSettings(causes=False, fmax=args.fmax, discard=args.discard, accept=args.accept, seed=args.seed)
    with activity(f"{args.recordings[0]}: fitting"), with_names(args):
        fitted = fit(read, settings)
        study = study_of(fitted, name, realizations=args.realizations, starts=args.starts)
    write_text(args.out, study.to_toml().rstrip("\n"))
    print(study)
    open_ = [e.name for e in fitted.estimates if e.verdict != "identifiable" and e.name in fitted.model.names]
    if open_:
        print(fill(f"Not determined by the recording, so its estimates are arbitrary true values: {', '.join(open_)}."))
    print(f"{args.out}: next: mcstudy plan {args.out}")
    return Exit.DONE
