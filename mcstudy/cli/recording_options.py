"""Arguments of the verbs that read recordings, and reading them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.cli.options import add_json_argument, add_out_argument
from mcstudy.cli.terminal import print_json

if TYPE_CHECKING:
    from mcstudy.cli.parser import Parser
    from mcstudy.recordings.frf import FrfRecording
    from mcstudy.recordings.recording import Recording


def add_recording_arguments(parser: Parser, nargs: str = "+") -> None:
    """Which recordings, and how they are read."""
    parser.add_argument(
        "recordings",
        nargs=nargs,
        type=Path,
        metavar="REC",
        help="recording: .nc, .zarr, .toml or .csv (your own data: `mcstudy help recordings`)",
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    parser.add_argument(
        "--fmax",
        type=float,
        metavar="HZ",
        help="highest frequency used (default 8, or the last of a published response; of a declared model a "
        "quarter of its sampling rate)",
    )
    parser.add_argument(
        "--discard",
        type=int,
        metavar="N",
        help="cycles left out at the start of each trial (default 1, more if the slowest oscillation needs them)",
    )
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="folder of the data files named in a .toml (default: its own)"
    )
    parser.add_argument(
        "--accept",
        action="append",
        default=[],
        metavar="CODE",
        help="accept the labels of the data despite the warning CODE; may be repeated",
    )


def add_output_arguments(parser: Parser, name: str) -> None:
    """Where and how the outcome ``name`` is told."""
    add_out_argument(parser, "DIR", f"also write {name}.json and {name}.txt")
    add_json_argument(parser)


def tell(args: argparse.Namespace, name: str, to_dict: Callable[[], dict[str, Any]], text: Callable[[], str]) -> None:
    """Print the outcome ``name``, whose schema has this name, and write it where it was asked for."""
    from mcstudy.files.json_files import json_text, write_json, write_text
    from mcstudy.text_tables import unfolded

    document = to_dict() if args.out or args.json else {}
    if args.out:
        write_json(args.out / f"{name}.json", document, name)
        with unfolded():
            write_text(args.out / f"{name}.txt", text())
    if args.json:
        print_json(json_text(document, name, name))
    else:
        print(text())


def add_model_argument(parser: Parser) -> None:
    """Which model is fitted."""
    parser.add_argument(
        "--model",
        metavar="NAME|FILE",
        help="a declared model (`mcstudy models`, or a .toml) whose outputs the columns of REC are, by name (default: "
        "the model that REC names, or two_segment)",
    )


def read_recordings(args: argparse.Namespace) -> list[Recording | FrfRecording]:
    """The recordings in the files that were named."""
    from mcstudy.recordings.io import read_recording

    model = getattr(args, "model", None)
    return [read_recording(path, data=args.data, model=model) for path in args.recordings]


@contextmanager
def with_names(args: argparse.Namespace) -> Iterator[None]:
    """Errors about the recordings begin with the names of their files."""
    from mcstudy.errors import RecordingError

    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{', '.join(map(str, args.recordings))}: {error}") from error
