"""The forms of a refusal, each once: errors of other layers named by place, values out of range, unknown words."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence

from mcstudy.errors import RecordingError
from mcstudy.stance.ranges import Range


@contextlib.contextmanager
def refused(*kinds: type[Exception], where: object = "") -> Iterator[None]:
    """Context manager: errors of these kinds become a `RecordingError` that begins with ``where``, unless they do."""
    try:
        yield
    except kinds as error:
        said = str(error)
        raise RecordingError(said if not where or said.startswith(str(where)) else f"{where}: {said}") from error


def require_within(allowed: Range, value: float | None, where: str) -> None:
    """Raise `RecordingError` for a value outside its range; None is not stated."""
    if value is not None and (fault := allowed.fault(value)):
        raise RecordingError(f"{where}: {fault}")


def require_known(word: str, known: Iterable[str], where: str, when: str = "") -> None:
    """Raise `RecordingError` for a word that is not one of those ``known``, or not ``when`` they alone can be."""
    if word not in (known := tuple(known)):
        raise RecordingError(f"{where}: expected one of {', '.join(known)}{when}, got {word!r}")


UNREAD = (OSError, ValueError, RuntimeError, KeyError, MemoryError)
"""What libraries raise for values that they cannot read."""


def first_line(error: Exception) -> str:
    """What a library says, in one line; the kind of error where it says nothing."""
    return (str(error).splitlines() or [type(error).__name__])[0][:300]


def size_text(shape: Sequence[int]) -> str:
    """A shape as people write it, 3 x 2."""
    return " x ".join(map(str, shape))
