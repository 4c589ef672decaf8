"""Arguments of the verbs that read recordings, and reading them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
        help="highest frequency used (default 8, or the last of a published response)",
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
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help=f"also write {name}.json and {name}.txt")
    parser.add_argument("--json", action="store_true", help="print JSON (described in results_schema)")


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


def read_recordings(args: argparse.Namespace) -> list[Recording | FrfRecording]:
    """The recordings in the files that were named."""
    from mcstudy.recordings.io import read_recording

    return [read_recording(path, data=args.data) for path in args.recordings]


@contextmanager
def with_names(args: argparse.Namespace) -> Iterator[None]:
    """Errors about the recordings begin with the names of their files."""
    from mcstudy.errors import RecordingError

    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{', '.join(map(str, args.recordings))}: {error}") from error
