"""Changes of JSON documents on disk."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path


def edit(place: str, value: object) -> Callable[[Path], None]:
    """Set one value of a JSON document, at ``outer.inner``, to something else than it was."""

    def change(file: Path) -> None:
        document = json.loads(file.read_text())
        *parents, last = place.split(".")
        inner = document
        for key in parents:
            inner = inner[key]
        assert inner.get(last) != value
        inner[last] = value
        file.write_text(json.dumps(document))

    return change
