"""What the command prints, whatever the terminal or the pipe can show."""

from __future__ import annotations

import contextlib
import os
import sys


def replace_what_cannot_be_shown() -> None:
    """Print a question mark for a character that the output's encoding lacks, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def drop_output() -> None:
    """Let what is still to be printed go nowhere: nothing takes it."""
    with contextlib.suppress(OSError, ValueError):  # an output that is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_json(text: str) -> None:
    """Print a JSON document, without loss in any encoding."""
    import json
    import re

    if (getattr(sys.stdout, "encoding", None) or "utf-8").lower().replace("-", "") != "utf8":
        text = re.sub(r"[^\x00-\x7f]+", lambda m: json.dumps(m[0])[1:-1], text)
    print(text)
