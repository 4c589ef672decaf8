"""The state of a results cube."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcstudy.files.local_path import local_path
from mcstudy.files.schema import identifier
from mcstudy.fitting.status import Status
from mcstudy.study.failures import account
from mcstudy.study.settled import settled
from mcstudy.study.store import Cube


@dataclass(frozen=True, kw_only=True)
class CubeStatus:
    """How far a study is.

    Attributes
    ----------
    path
        The cube.
    study, seed, fingerprint
        Of its study.
    groups
        Number of fits by status, for every group: ``groups["accuracy"]["converged"]``.
    failed
        One line for each of the first failed fits: group, cell and reason; the last line counts those left out.
    """

    path: Path
    study: str
    seed: int
    fingerprint: str
    groups: dict[str, dict[str, int]]
    failed: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether every fit has been run."""
        return not any(counts["pending"] for counts in self.groups.values())

    def to_dict(self) -> dict[str, Any]:
        """What the schema ``status`` describes."""
        return {
            "schema": identifier("status"),
            "study": self.study,
            "fingerprint": self.fingerprint,
            "groups": self.groups,
        }


def status(out: str | Path) -> CubeStatus:
    """Numbers of fits of a results cube by status, and which fits failed; a run may be writing to it.

    Parameters
    ----------
    out
        Path of the cube.

    Returns
    -------
    CubeStatus
        ``groups``, ``failed``, ``complete``.

    Raises
    ------
    StoreError
        It is no cube, or its study cannot be read.
    """
    path = local_path(out)

    def read() -> CubeStatus:
        cube = Cube.open(path)
        by_group, failed = account(cube)
        return CubeStatus(
            path=cube.path,
            study=cube.study.study.name,
            seed=cube.study.study.seed,
            fingerprint=cube.study.fingerprint,
            groups={name: {s.name.lower(): counts[s] for s in Status} for name, counts in by_group.items()},
            failed=tuple(failed),
        )

    return settled([path], read)
