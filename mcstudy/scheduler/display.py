"""Progress lines that are updated in place on a terminal or in a notebook, and printed rarely to a plain stream."""

from __future__ import annotations

import html
import shutil
import sys
import textwrap
import time
from collections.abc import Sequence
from typing import Any, TextIO

PLAIN_EVERY_S = 10.0
LIVE_EVERY_S = 0.2


class Display:
    """Shows a few lines, which replace those shown before.

    Parameters
    ----------
    stream: where to write; stderr, or the cell of a notebook when there is one.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._cell = _notebook_cell() if stream is None else None
        self._terminal = self._cell is None and self._stream.isatty()
        self._height, self._shown = 0, time.monotonic()

    @property
    def live(self) -> bool:
        """Whether lines replace each other; a plain stream keeps all lines and therefore gets few."""
        return self._terminal or self._cell is not None

    def due(self) -> bool:
        """Whether an update is due."""
        return time.monotonic() - self._shown >= (LIVE_EVERY_S if self.live else PLAIN_EVERY_S)

    def show(self, lines: Sequence[str]) -> None:
        """Show lines; they replace the previous ones."""
        self._shown = time.monotonic()
        if self._cell is not None:
            self._cell.update(_Text(lines))
        elif self._terminal:
            width = shutil.get_terminal_size().columns - 1  # lines wrapped by the terminal could not be erased
            wrapped = [part for line in lines for part in textwrap.wrap(line, max(width, 20), subsequent_indent="  ")]
            self._write(self._back() + "".join(f"{line}\n" for line in wrapped))
            self._height = len(wrapped)
        else:
            self._write("".join(f"{line}\n" for line in lines))

    def say(self, message: str) -> None:
        """Print a message that stays; the lines of `show` are repeated below it."""
        self._write(f"{self._back()}{message}\n")
        self._height = 0

    def clear(self) -> None:
        """Take the lines of `show` away, where they can be taken away."""
        if self._cell is not None:
            self._cell.update(_Text([]))
        self._write(self._back())
        self._height = 0

    def _back(self) -> str:
        """Control sequence that erases the last lines of a terminal."""
        up = f"\033[{self._height}A" if self._height else ""
        return f"{up}\r\033[J" if self._terminal else ""

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


class _Text:
    """Lines as a cell of a notebook shows them."""

    def __init__(self, lines: Sequence[str]) -> None:
        self.lines = tuple(lines)

    def __repr__(self) -> str:
        return "\n".join(self.lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"


def _notebook_cell() -> Any | None:
    """A handle of the running notebook cell's output; None outside a notebook (a terminal's IPython is none)."""
    module = sys.modules.get("IPython")  # a notebook has always imported it
    shell = module.get_ipython() if module is not None else None
    if shell is None or not hasattr(shell, "kernel"):
        return None
    from IPython.display import display  # type: ignore[import-not-found, unused-ignore]

    return display(_Text([""]), display_id=True)
