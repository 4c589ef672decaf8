"""Study fingerprint and run environment of a cube, recovered from redundant copies.

Everything else in an empty cube follows from the study, the environment and the number of realizations per chunk. The
fingerprint and the environment cannot be recomputed, so damage could lose or change them. They are therefore stored in
the root, in every group, in the root's copy of the groups' metadata, and in the run log next to the cube.
"""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from mcstudy.errors import DesignError, StoreError
from mcstudy.study.cube.metadata import folders, whole_document
from mcstudy.study.cube.run_log import events, last_begin
from mcstudy.study.environment import label
from mcstudy.study.study_file import parse_study


def fingerprint_of(path: Path) -> str | None:
    """Fingerprint of the study of a cube that may be damaged; None when no copy is readable."""
    copies, root = _group_copies(path), _root(path)
    said = [copy.get("fingerprint") for copy in copies]
    with contextlib.suppress(DesignError, KeyError, TypeError, AttributeError):
        said.append(parse_study(root["study"]).fingerprint)
    said += [last_begin(path).get("fingerprint"), root.get("fingerprint")]
    return _most(value for value in said if isinstance(value, str))


def made_in(path: Path) -> dict[str, Any] | None:
    """Environment in which a cube, which may be damaged, was created; None when no copy is readable."""
    copies = (*_group_copies(path), _root(path))
    said = [last_begin(path).get("made_in"), *(copy.get("environment") for copy in copies)]
    return _most(value for value in said if isinstance(value, dict) and isinstance(value.get("versions"), dict))


def environments(path: Path) -> dict[str, dict[str, Any]]:
    """Environments, by label, that the chunks of a cube name besides the one that it was created in.

    Each is what the root holds under its label or, where that is damaged, what the run log does.
    """
    root = _root(path)
    held = root.get("environments", {} if root else None)
    logged = {label(record): record for e in events(path) if isinstance(record := e.get("environment"), dict)}
    if held is None:  # the root cannot be read
        return {name: record for name, record in logged.items() if record != made_in(path)}
    noted = held if isinstance(held, dict) else {}
    both = {name: record if label(record) == name else logged.get(name) for name, record in noted.items()}
    return {name: record for name, record in sorted(both.items()) if record is not None}


def _most(values: Iterable[Any]) -> Any:
    """The most frequent value, the first one of equals; None if there are no values."""
    counted = Counter(json.dumps(value) for value in values)  # dictionaries are not hashable
    return json.loads(counted.most_common(1)[0][0]) if counted else None


def _root(path: Path) -> dict[str, Any]:
    with contextlib.suppress(StoreError):
        return dict(whole_document(path).get("attributes", {}))
    return {}


def _group_copies(path: Path) -> list[dict[str, Any]]:
    """Readable attributes of every group: first from the groups themselves, then from their copy in the root."""
    return [copy for copy in (*_own(path), *_copied(path)) if isinstance(copy, dict)]


def _own(path: Path) -> Iterator[Any]:
    for folder in folders(path) if path.is_dir() else ():
        with contextlib.suppress(StoreError):
            yield whole_document(folder).get("attributes")


def _copied(path: Path) -> Iterator[Any]:
    with contextlib.suppress(StoreError, KeyError, TypeError, AttributeError):
        for name, node in whole_document(path)["consolidated_metadata"]["metadata"].items():
            if "/" not in name:
                yield node.get("attributes")
