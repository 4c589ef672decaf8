"""The command in this process: what it prints, or the one line with which it refuses."""

from __future__ import annotations

import contextlib
import io
from typing import NamedTuple

from mcstudy.cli import main
from mcstudy.exits import Exit


class Said(NamedTuple):
    """Exit code and both outputs of a command."""

    code: int
    out: str
    err: str


def command(*words: object) -> Said:
    """Run ``mcstudy`` with these words."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = main([str(word) for word in words])
    return Said(int(code), out.getvalue(), err.getvalue())


def told(*words: object) -> str:
    """What a command that succeeds prints."""
    said = command(*words)
    assert said.code == Exit.DONE, said.err
    return said.out


def refused(*words: object) -> str:
    """The one line of a command that refuses what it is given."""
    said = command(*words)
    assert (said.code, said.out) == (Exit.BAD_INPUT, "")
    assert said.err.startswith("mcstudy: ")
    assert said.err.count("\n") == 1
    return said.err
