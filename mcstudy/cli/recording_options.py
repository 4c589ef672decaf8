"""Arguments of the verbs that read recordings, and reading them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mcstudy.recordings.frf import FrfRecording
    from mcstudy.recordings.recording import Recording


def add_recording_arguments(parser: argparse.ArgumentParser) -> None:
    """Which recordings, and how they are read."""
    parser.add_argument(
        "recordings",
        nargs="+",
        type=Path,
        metavar="REC",
        help="recording: .nc, .zarr, .toml or .csv (your own data: `mcstudy help recordings`)",
    )
    parser.add_argument("--seed", type=int, default=0, help="random seed (default 0)")
    parser.add_argument("--fmax", type=float, default=8.0, metavar="HZ", help="highest frequency used (default 8)")
    parser.add_argument(
        "--discard", type=int, default=1, metavar="N", help="cycles left out at the start of each trial (default 1)"
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
