"""What a scheduler has done is handed back, however it says so."""

from __future__ import annotations

from typing import Any

import pytest

from mcstudy.errors import Interrupted
from mcstudy.scheduler.window import Window


class Forgotten:
    """A future that ends and tells nobody."""

    key = "forgotten"

    def __init__(self) -> None:
        self.ended = False

    def add_done_callback(self, _: object) -> None:
        """Lose it."""

    def done(self) -> bool:
        return self.ended


class Client:
    """A client with one future."""

    def __init__(self, future: Forgotten) -> None:
        self.future = future

    def submit(self, *_: Any, **__: Any) -> Forgotten:
        return self.future


def test_a_future_whose_end_is_not_told_is_found() -> None:
    future = Forgotten()
    window = Window[str](Client(future), pytest.fail, Interrupted)  # type: ignore[arg-type]
    window.submit("work", print)
    assert window.ended(0.01) is None
    future.ended = True
    assert window.ended(0.01) == ("work", future)
    assert window.ended(0.01) is None
