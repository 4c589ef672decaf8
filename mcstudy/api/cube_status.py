"""Progress of a results cube; it imports no more than is needed to count."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcstudy.files.schema import identifier
from mcstudy.fitting.status import Status
from mcstudy.study.cube.replacement import settled
from mcstudy.study.cube.store import Cube
from mcstudy.study.failures import account


@dataclass(frozen=True)
class CubeStatus:
    """Fits of a cube by status.

    Attributes
    ----------
    path: of the cube. study, seed, fingerprint: of its study.
    groups: number of fits by group and by name of the status (``pending``, ``converged``, ...).
    failed: one line per failed fit or block.
    """

    path: Path
    study: str
    seed: int
    fingerprint: str
    groups: dict[str, dict[str, int]]
    failed: list[str]

    @property
    def pending(self) -> int:
        """Fits that are not run yet."""
        return sum(counts["pending"] for counts in self.groups.values())

    def to_dict(self) -> dict[str, Any]:
        """The content of ``mcstudy status --json`` (schema ``status``)."""
        named = {"study": self.study, "fingerprint": self.fingerprint}
        return {"schema": identifier("status"), **named, "groups": self.groups}


def status(cube: str | Path) -> CubeStatus:
    """Count the fits of a cube by status; it may be running.

    Parameters
    ----------
    cube
        Path of a results cube.

    Returns
    -------
    CubeStatus
        Numbers by group, and the failed fits.

    Raises
    ------
    StoreError
        The cube cannot be read.
    """
    path = Path(cube)

    def counted() -> CubeStatus:
        opened = Cube.open(path)
        by_group, failed = account(opened)
        groups = {name: {s.name.lower(): counts[s] for s in Status} for name, counts in by_group.items()}
        study = opened.study
        return CubeStatus(opened.path, study.study.name, study.study.seed, study.fingerprint, groups, failed)

    return settled([path], counted)
