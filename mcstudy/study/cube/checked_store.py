"""The store of a cube that Zarr reads by the checksums; `checksums` itself needs no Zarr."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Self

from mcstudy.files.guarded_store import GuardedStore
from mcstudy.study.cube.checksums import Checked
from mcstudy.study.cube.layout import Layout
from mcstudy.study.cube.replacement import stamp


class CheckedStore(GuardedStore):
    """A store that reads a cube as `Checked` does: a missing or swapped chunk gives an error, not numbers.

    ``layouts``: of the groups that are read. ``fingerprint``: of the study.
    """

    def __init__(
        self, root: Path | str, layouts: Mapping[str, Layout], fingerprint: str, *, read_only: bool = True
    ) -> None:
        super().__init__(root, read_only=read_only)
        self._checked = Checked(self.root, layouts, fingerprint, stamp(self.root))

    def with_read_only(self, read_only: bool = False) -> Self:
        """The same store, read-only or writable."""
        return type(self)(self.root, self._checked.layouts, self._checked.fingerprint, read_only=read_only)

    def content(self, key: str) -> bytes | None:
        """One value; None where a chunk has not been run, `StoreError` where it is missing or swapped."""
        return self._checked.content(key)
