"""Either a value or a refusal in one line: what tests with random input may find."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mcstudy.errors import InputError


def or_refused(work: Callable[[], Any]) -> Any:
    """What ``work`` returns, None when it is refused in one line; any other exception fails the test."""
    said = ""
    try:
        return work()
    except InputError as error:
        said = str(error)
    assert said
    assert "\n" not in said
    assert len(said) < 2000
    said.encode()
    return None
