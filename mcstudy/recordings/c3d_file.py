"""C3D files of motion laboratories: markers and joint angles (points), analog channels, events.

A point ``LASI`` gives ``LASI.x``, ``LASI.y`` and ``LASI.z``, analog channels have their label, events are
``EVENT.label``, times in s from the first frame. Frames without a marker are missing. Read with the library c3d (pure
Python, MIT), which handles files of Intel, DEC and MIPS processors. The compiled library ezc3d (1.7.2) ended the
process on 3 of the first 111 files in which one to four bytes had been changed.
"""

from __future__ import annotations

import io
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import InputError, RecordingError
from mcstudy.recordings.columns import content
from mcstudy.recordings.variables import MOST_VARIABLES, Variable

LARGEST = 1 << 30
"""Bytes of a file."""

AXES = ("x", "y", "z")


def variables_of(path: Path) -> dict[str, Variable]:
    """All points, analog channels and events of a file by name; raises `RecordingError`."""
    try:
        import c3d
    except ImportError:
        raise InputError(f"{path}: reading C3D needs the package c3d; pip install c3d") from None
    raw = content(path, LARGEST)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the library's remarks on metadata that is not used
            reader = c3d.Reader(io.BytesIO(raw))
            return _variables(reader, len(raw), path)
    except RecordingError:
        raise
    except Exception as error:  # the library checks with assertions and raises what struct and numpy raise
        reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
        raise RecordingError(f"{path}: expected C3D: {reason}") from None


def _variables(reader: Any, size: int, path: Path) -> dict[str, Variable]:
    points, analogs, rate = int(reader.point_used), int(reader.analog_used), float(reader.point_rate)
    if not rate > 0:
        raise RecordingError(f"{path}: POINT:RATE: expected frames per second, got {rate:g}")
    per_frame = int(reader.analog_per_frame) if analogs else 0
    frames = int(reader.frame_count)
    if 3 * points + analogs > MOST_VARIABLES:
        raise RecordingError(f"{path}: expected at most {MOST_VARIABLES} points and channels")
    width = (4 * points + analogs * per_frame) * (4 if reader.point_scale < 0 else 2)
    start = (int(reader.header.data_block) - 1) * 512
    if frames < 1 or width < 1 or start < 0:
        raise RecordingError(f"{path}: expected frames of points or analog channels, found none")
    if start + frames * width > size:
        raise RecordingError(f"{path}: cut off: {frames} frames declared, {max(size - start, 0) // width} are there")
    position, analog = _frames(reader, frames, points, analogs, per_frame)
    out = {}
    angles = set(_texts(reader, "POINT:ANGLES"))
    length, angle = _text(reader, "POINT:UNITS"), _text(reader, "POINT:ANGLE_UNITS")
    for k, label in enumerate(_labels(reader, "POINT", points)):
        unit = (angle or "deg") if label in angles else length
        for axis, name in enumerate(AXES):
            full = f"{label}.{name}"
            out[full] = Variable(full, (frames,), partial(_column, position, (slice(None), k, axis)), unit, rate)
    units = _texts(reader, "ANALOG:UNITS")
    for k, label in enumerate(_labels(reader, "ANALOG", analogs)):
        name = label if label not in out else f"ANALOG.{label}"
        unit = units[k] or None if k < len(units) else None
        out[name] = Variable(name, (analog.shape[1],), partial(_column, analog, (k,)), unit, rate * per_frame)
    return out | _events(reader, rate)


def _column(values: np.ndarray, index: tuple[Any, ...]) -> np.ndarray:
    return np.asarray(values[index])


def _frames(reader: Any, frames: int, points: int, analogs: int, per_frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (frames, points, 3), nan where a marker was not seen, and channels (analogs, samples)."""
    position = np.full((frames, points, 3), np.nan)
    analog = np.full((analogs, frames * per_frame), np.nan)
    for k, (_, point, channel) in enumerate(reader.read_frames(copy=False)):
        if k >= frames:
            break
        seen = point[:, 3] >= 0
        position[k, seen] = point[seen, :3]
        if analogs and per_frame:
            analog[:, k * per_frame : (k + 1) * per_frame] = channel
    return position, analog


def _texts(reader: Any, key: str) -> list[str]:
    found = reader.get(key)
    return [] if found is None else [str(text).strip("\0 ") for text in np.atleast_1d(found.string_array).ravel()]


def _text(reader: Any, key: str) -> str | None:
    found = reader.get(key)
    return None if found is None else str(found.string_value).strip("\0 ") or None


def _labels(reader: Any, group: str, count: int) -> list[str]:
    """Labels of points or channels, each once; more than 255 continue in LABELS2, LABELS3, ..."""
    given = _texts(reader, f"{group}:LABELS")
    for k in range(2, 2 + count // 255):
        given += _texts(reader, f"{group}:LABELS{k}")
    names: list[str] = []
    for k in range(count):
        name = given[k] if k < len(given) and given[k] else f"{group.lower()}{k}"
        names.append(name if name not in names else f"{name}#{k}")
    return names


def _events(reader: Any, rate: float) -> dict[str, Variable]:
    """Times of events by label. The file counts them from frame 1, in minutes and seconds."""
    labels, times = _texts(reader, "EVENT:LABELS"), reader.get("EVENT:TIMES")
    if not labels or times is None:
        return {}
    minutes = np.asarray(times.float_array, dtype=float).reshape(-1, 2)
    seconds = 60 * minutes[:, 0] + minutes[:, 1] - (int(reader.first_frame) - 1) / rate
    out = {}
    for label in dict.fromkeys(labels):
        own = np.array([t for name, t in zip(labels, seconds, strict=False) if name == label])
        out[f"EVENT.{label}"] = Variable(f"EVENT.{label}", own.shape, partial(_column, own, ()), "s")
    return out
