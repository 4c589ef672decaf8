"""Elements of MATLAB files of version 5, written by hand."""

from __future__ import annotations

import struct


def tagged(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def array(kind: int, shape: tuple[int, ...], name: bytes, rest: bytes) -> bytes:
    head = tagged(6, struct.pack("<II", kind, 0)) + tagged(5, struct.pack(f"<{len(shape)}i", *shape)) + tagged(1, name)
    return tagged(14, head + rest)


HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
