"""Zarr's local store, guarded. Apart from `mcstudy.files.untrusted`: importing Zarr is slower than reading a file."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

from zarr.abc.buffer import Buffer, BufferPrototype
from zarr.abc.store import ByteRequest
from zarr.buffer import default_buffer_prototype
from zarr.storage import LocalStore

from mcstudy.errors import StoreError
from mcstudy.files.untrusted import stored_bytes


class GuardedStore(LocalStore):
    """Zarr's local store; follows no links and passes no chunk to a codec that `check_chunk` refuses."""

    def get_sync(
        self, key: str, *, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """One value, None when there is none."""
        if byte_range is not None:
            raise StoreError(f"{self.root / key}: expected chunks that are read whole, found shards")
        content = self.content(key)
        return None if content is None else (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    def content(self, key: str) -> bytes | None:
        """One value as it is in its file."""
        return stored_bytes(self.root, key)

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """One value, None when there is none."""
        return await asyncio.to_thread(self.get_sync, key, prototype=prototype, byte_range=byte_range)

    async def get_partial_values(
        self, prototype: BufferPrototype, key_ranges: Iterable[tuple[str, ByteRequest | None]]
    ) -> list[Buffer | None]:
        """Several values."""
        return [await self.get(key, prototype, byte_range) for key, byte_range in key_ranges]
