"""C3D files as laboratories have them, written by hand: every processor, stored as floats or as scaled integers."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

BLOCK = 512

PROCESSORS = {"intel": 84, "dec": 85, "mips": 86}


def write_c3d(
    path: Path,
    points: Mapping[str, np.ndarray],
    analog: Mapping[str, np.ndarray],
    rate_hz: float,
    *,
    angles: Sequence[str] = (),
    units: str = "mm",
    analog_units: Sequence[str] = (),
    events: Mapping[str, Sequence[float]] | None = None,
    processor: str = "intel",
    scale: float = -1.0,
    analog_scale: float = 1.0,
    offset: int = 0,
    first: int = 1,
    header: Mapping[int, int] | None = None,
    parameters: Mapping[str, Any] | None = None,
    fill: bool = True,
) -> None:
    """Points (n, 3), nan where not seen, and channels (k n,) of k samples per frame; events in s.

    ``scale`` above 0: integers of 16 bits, times this, in the unit of the points; a channel is stored as
    value / ``analog_scale`` + ``offset``. ``first``: number of the first frame. ``header``: words (from 0) and
    ``parameters``: values by GROUP:NAME that replace what would be stated (None: not stated). ``fill``: zeros up to a
    whole block behind the data.
    """
    count = len(next(iter(points.values()))) if points else len(next(iter(analog.values())))
    per_frame = len(next(iter(analog.values()))) // count if analog else 0
    stated: dict[str, Any] = {
        "POINT:USED": np.int16([len(points)]),
        "POINT:SCALE": np.float32([scale]),
        "POINT:RATE": np.float32([rate_hz]),
        "POINT:DATA_START": np.int16([0]),
        "POINT:FRAMES": np.uint16([count % 65536]).view(np.int16),
        "POINT:LABELS": list(points),
        "POINT:UNITS": units,
        "ANALOG:USED": np.int16([len(analog)]),
        "ANALOG:LABELS": list(analog),
        "ANALOG:GEN_SCALE": np.float32([1.0]),
        "ANALOG:SCALE": np.full(len(analog), analog_scale, np.float32),
        "ANALOG:OFFSET": np.full(len(analog), offset, np.uint16).view(np.int16),
        "ANALOG:UNITS": list(analog_units),
        "ANALOG:RATE": np.float32([rate_hz * per_frame]),
    }
    if angles:
        stated |= {"POINT:ANGLES": list(angles), "POINT:ANGLE_UNITS": "deg"}
    if events:
        times = [t for own in events.values() for t in own]
        stated["EVENT:LABELS"] = [name for name, own in events.items() for _ in own]
        stated["EVENT:TIMES"] = np.array([[t // 60, t % 60] for t in times], np.float32)
    stated |= parameters or {}
    size = len(_section(stated, processor))
    start = 2 + -(-size // BLOCK)
    if stated["POINT:DATA_START"] is not None:
        stated["POINT:DATA_START"] = np.int16([start])
    words = [0x5002, len(points), len(analog) * per_frame, first, min(first + count - 1, 65535), 0]
    words[0] = 0x5002 if processor != "mips" else 0x0250
    front = _numbers(np.uint16(words), processor) + _numbers(np.float32([scale]), processor)
    front += _numbers(np.uint16([start, per_frame]), processor) + _numbers(np.float32([rate_hz]), processor)
    head = bytearray(front.ljust(BLOCK, b"\0"))
    for word, value in (header or {}).items():
        head[2 * word : 2 * word + 2] = _numbers(np.uint16([value]), processor)
    frames = np.zeros((count, 4 * len(points) + len(analog) * per_frame))
    for k, values in enumerate(points.values()):
        seen = np.isfinite(values).all(axis=1)
        frames[:, 4 * k : 4 * k + 3] = np.where(seen[:, None], values, 0.0) / (scale if scale > 0 else 1.0)
        frames[:, 4 * k + 3] = np.where(seen, 0.0, -1.0)
    for k, channel in enumerate(analog.values()):
        frames[:, 4 * len(points) + k :: len(analog)] = channel.reshape(count, -1) / analog_scale + offset
    stored = frames.astype(np.float32) if scale < 0 else np.rint(frames).astype(np.int64).astype(np.uint16)
    data = _numbers(stored, processor)
    section = _section(stated, processor).ljust((start - 2) * BLOCK, b"\0")
    path.write_bytes(bytes(head) + section + data + bytes(-len(data) % BLOCK if fill else 0))


def _numbers(values: np.ndarray, processor: str) -> bytes:
    """Numbers as a processor stores them; DEC's floats have another bias and their first word in front."""
    if processor == "dec" and values.dtype.kind == "f":
        words = (4 * values.astype("<f4")).view("<u2").reshape(-1, 2)
        return words[:, ::-1].tobytes()
    return values.astype(values.dtype.newbyteorder(">" if processor == "mips" else "<")).tobytes()


def _section(stated: Mapping[str, Any], processor: str) -> bytes:
    """The parameter section: groups, then their parameters."""
    names = list(dict.fromkeys(key.split(":")[0] for key in stated))
    out = bytes([1, 0x50, 0, PROCESSORS[processor]])
    for k, name in enumerate(names, start=1):
        out += _record(name, -k, b"\0", processor)
    for key, value in stated.items():
        if value is not None:
            group, name = key.split(":")
            out += _record(name, names.index(group) + 1, _value(value, processor) + b"\0", processor)
    return out + b"\0\0"


def _record(name: str, group: int, body: bytes, processor: str) -> bytes:
    offset = _numbers(np.uint16([2 + len(body)]), processor)
    return struct.pack("<bb", len(name), group) + name.encode() + offset + body


def _value(value: Any, processor: str) -> bytes:
    if isinstance(value, str):
        return struct.pack("<bBB", -1, 1, len(value.encode())) + value.encode()
    if isinstance(value, list):
        texts = [text.encode() for text in value]
        width = max(map(len, texts), default=0)
        return struct.pack("<bBBB", -1, 2, width, len(texts)) + b"".join(t.ljust(width) for t in texts)
    array = np.asarray(value)
    shape = array.shape[::-1]  # the first index runs fastest there
    return struct.pack("<bB", array.dtype.itemsize, len(shape)) + bytes(shape) + _numbers(array, processor)
