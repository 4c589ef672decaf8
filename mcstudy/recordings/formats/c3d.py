"""C3D files of motion laboratories: markers and joint angles (points), analog channels, events.

A point ``LASI`` gives ``LASI.x``, ``LASI.y`` and ``LASI.z``, analog channels have their label, events are
``EVENT.label``, times in s from the first frame. Frames without a marker are missing. How many frames there are is
stated in up to four places, some of which end at 65,535 or count from 0: the bytes of the file decide.

The file is parsed here. The compiled library ezc3d (1.7.2), with which the tests compare, reads what is left of a
truncated file without a word, loses points to single changed bytes, and ends the process on some files, among them
sound ones. The library c3d (0.6.0) counts frames wrongly and needs more than one analog channel.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.c3d_parameters import BLOCK, Damaged, Parameters, parameters_of
from mcstudy.recordings.formats.source import MOST_VARIABLES, Source, Variable
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.guards import content
from mcstudy.text_tables import printable

LARGEST = 1 << 30
"""Bytes of a file."""

AXES = ("x", "y", "z")

FULL = 1 << 16
"""What a count of 16 bits cannot state."""

KINDS = {"ANGLES": "ANGLE_UNITS", "FORCES": "FORCE_UNITS", "MOMENTS": "MOMENT_UNITS", "POWERS": "POWER_UNITS"}
"""Parameters that name the points which are no positions, and the one that states their unit."""


def source(path: Path, dialect: Dialect) -> Source:  # noqa: ARG001 - nothing about text applies
    """The variables of a C3D file; raises `RecordingError`."""
    return Source(path, "C3D", variables_of(path))


def variables_of(path: Path) -> dict[str, Variable]:
    """All points, analog channels and events of a file by name; raises `RecordingError`."""
    raw = content(path, LARGEST)
    try:
        return _variables(raw, parameters_of(raw))
    except Damaged as error:
        raise RecordingError(f"{path}: expected C3D: {printable(str(error))}") from None


def _variables(raw: bytes, parameters: Parameters) -> dict[str, Variable]:
    points, analogs = _stated(parameters.count("POINT:USED"), parameters.header[1]), parameters.count("ANALOG:USED")
    rate = _first(parameters.floats("POINT:RATE"), parameters.rate_hz)
    if not (np.isfinite(rate) and rate > 0):
        raise Damaged(f"POINT:RATE: expected frames per second, got {rate:g}")
    per_frame = int(parameters.header[9])
    if analogs is None:
        analogs = int(parameters.header[2]) // per_frame if per_frame else 0
    elif analogs:
        per_frame = _whole_ratio(_first(parameters.floats("ANALOG:RATE"), rate * per_frame), rate)
    if not points and not analogs:
        raise Damaged(_without_points(parameters))
    if 3 * points + analogs > MOST_VARIABLES:
        raise Damaged(f"expected at most {MOST_VARIABLES} points and channels")
    scale = _first(parameters.floats("POINT:SCALE"), parameters.scale)
    kind = "f4" if scale < 0 else "i2"
    words = _frames(raw, parameters, 4 * points + analogs * per_frame, kind)
    samples = words
    if kind == "i2" and "UNSIGNED" in (t.upper() for t in parameters.texts("ANALOG:FORMAT")):
        samples = words.view(words.dtype.str.replace("i", "u"))
    out = {}
    units, length = _point_units(parameters), (parameters.texts("POINT:UNITS") or [""])[0]
    for k, label in enumerate(_labels(parameters, "POINT", points)):
        for axis, name in enumerate(AXES):
            full, unit = f"{label}.{name}", units.get(label, length) or None
            factor = 1.0 if kind == "f4" else scale
            out[full] = Variable(full, (len(words),), partial(_coordinate, words, k, axis, factor), unit, rate)
    offset, factors = _calibration(parameters, analogs)
    stated = parameters.texts("ANALOG:UNITS")
    for k, label in enumerate(_labels(parameters, "ANALOG", analogs)):
        name = label if label not in out else f"ANALOG.{label}"
        unit = stated[k] or None if k < len(stated) else None
        values = samples[:, 4 * points + k :: analogs]
        read = partial(_channel, values, float(offset[k]), float(factors[k]))
        out[name] = Variable(name, (values.size,), read, unit, rate * per_frame)
    return out | _events(parameters, rate)


def _stated(parameter: int | None, header: int) -> int:
    return int(header) if parameter is None else parameter


def _first(values: np.ndarray, otherwise: float) -> float:
    return float(values[0]) if values.size else float(otherwise)


def _whole_ratio(analog_hz: float, rate: float) -> int:
    """Samples of a channel per frame."""
    ratio = analog_hz / rate
    if not (np.isfinite(ratio) and 1 <= round(ratio) < FULL and abs(ratio - round(ratio)) < 1e-3 * ratio):
        raise Damaged(f"ANALOG:RATE: expected a multiple of POINT:RATE ({rate:g}), got {analog_hz:g}")
    return round(ratio)


def _without_points(parameters: Parameters) -> str:
    rotations = parameters.count("ROTATION:USED")
    if rotations:
        return (
            f"a file with points or analog channels, found {rotations} rotations of segments only; "
            "export the file again with markers or joint angles"
        )
    return "points or analog channels, found none"


def _frames(raw: bytes, parameters: Parameters, width: int, kind: str) -> np.ndarray:
    """The words of every frame (frames, width), as stored; no more and no fewer than the file holds."""
    start = (_stated(parameters.count("POINT:DATA_START"), parameters.header[8]) - 1) * BLOCK
    if start <= 0:
        raise Damaged("POINT:DATA_START: expected the block at which the data begin")
    later = (parameters.start, ((parameters.count("ROTATION:DATA_START") or 0) - 1) * BLOCK)
    end = min([len(raw), *(section for section in later if section > start)])
    size = width * (4 if kind == "f4" else 2)
    data = memoryview(raw)[start:end]
    count = _frame_count(parameters, data, size)
    return parameters.numbers.read(data[: count * size], kind).reshape(count, width)


def _frame_count(parameters: Parameters, data: memoryview, size: int) -> int:
    """How many frames of ``size`` bytes the data hold.

    Whole frames may be followed by what fills up the last block, in some programs by a whole one. A count that is
    stated holds when that is all it leaves over; among several, the one behind which all bytes are zero. A count of
    16 bits that cannot hold is passed over when the number of frames there would not fit in it.
    """
    there = len(data) // size
    used = len(bytes(data).rstrip(b"\0"))  # the data without what fills up the last block
    counts, long = _stated_counts(parameters)
    fitting = sorted(n for n in (*counts, *long) if 0 < n <= there and len(data) - n * size <= BLOCK)
    fitting += sorted(n for n in (*counts, *long) if 0 < n <= there and used <= n * size and n not in fitting)
    for n in fitting:
        if used <= n * size:
            return n
    least = max(1, -(-max(used, len(data) - BLOCK) // size))  # frames with data, in all but the last block
    if not long and there >= FULL - 1 and any(n >= FULL - 2 or (there - n) % FULL <= there - least for n in counts):
        return least
    if fitting:
        return max(fitting)
    if there and not counts and not long:
        return least
    declared = max((*long, *counts), default=0)
    if declared > there:
        raise Damaged(f"cut off: {declared} frames declared, {there} are there")
    raise Damaged(f"{declared} frames declared (POINT:FRAMES and header), {least if there else 0} are there")


def _stated_counts(parameters: Parameters) -> tuple[set[int], set[int]]:
    """Numbers of frames that the file states: in 16 bits, and in more. Some programs count them from 0."""
    first, last = int(parameters.header[3]), int(parameters.header[4])
    begin, end = parameters.long("TRIAL:ACTUAL_START_FIELD"), parameters.long("TRIAL:ACTUAL_END_FIELD")
    frames = parameters.count("POINT:FRAMES") or 0
    short = {last - first + 1 if last else 0, last if first == 0 else 0, frames if frames < FULL else 0}
    long = {parameters.count("POINT:LONG_FRAMES") or 0, frames if frames >= FULL else 0}
    if end is not None:
        begin = 1 if begin is None else begin
        long |= {end - begin + 1, end if begin == 0 else 0}
    return {n for n in short if n > 0}, {n for n in long if n > 0}


def _coordinate(words: np.ndarray, point: int, axis: int, factor: float) -> np.ndarray:
    """A coordinate, nan where the fourth word of the point is negative: its marker was not seen."""
    value = factor * words[:, 4 * point + axis].astype(float)
    value[~_seen(words[:, 4 * point + 3])] = np.nan
    return value


def _seen(residual: np.ndarray) -> np.ndarray:
    """Whether a word, which as a float holds the value of a 16-bit integer, is not negative; some write it unsigned."""
    return np.asarray((residual >= 0) & (residual < FULL // 2))


def _channel(values: np.ndarray, offset: float, factor: float) -> np.ndarray:
    return (values.ravel().astype(float) - offset) * factor


def _calibration(parameters: Parameters, analogs: int) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and factors of the channels: value = (stored - offset) factor. One number is that of every channel."""
    offset, scale = parameters.floats("ANALOG:OFFSET"), parameters.floats("ANALOG:SCALE")
    if "UNSIGNED" in (t.upper() for t in parameters.texts("ANALOG:FORMAT")):
        offset = np.where(offset < 0, offset + FULL, offset)
    out = []
    for name, given, otherwise in (("OFFSET", offset, 0.0), ("SCALE", scale, 1.0)):
        if given.size < 2:
            out.append(np.full(analogs, _first(given, otherwise)))
        elif given.size < analogs:
            raise Damaged(f"ANALOG:{name}: expected a number for each of {analogs} channels, got {given.size}")
        else:
            out.append(given[:analogs])
    return out[0], out[1] * _first(parameters.floats("ANALOG:GEN_SCALE"), 1.0)


def _point_units(parameters: Parameters) -> dict[str, str]:
    """Units of the points that are no positions."""
    given = {kind: (parameters.texts(f"POINT:{units}") or [""])[0] for kind, units in KINDS.items()}
    given["ANGLES"] = given["ANGLES"] or "deg"
    return {label: unit for kind, unit in given.items() for label in parameters.texts(f"POINT:{kind}")}


def _labels(parameters: Parameters, group: str, count: int) -> list[str]:
    """Labels of points or channels, each once."""
    given = parameters.texts(f"{group}:LABELS")
    names: dict[str, None] = {}
    for k in range(count):
        name = given[k] if k < len(given) and given[k] else f"{group.lower()}{k}"
        names[name if name not in names else f"{name}#{k}"] = None
    return list(names)


def _events(parameters: Parameters, rate: float) -> dict[str, Variable]:
    """Times of events by label. The file counts them from frame 1, in minutes and seconds."""
    labels, times = parameters.texts("EVENT:LABELS"), parameters.floats("EVENT:TIMES")
    if not labels or not times.size:
        return {}
    if times.size % 2:
        raise Damaged("EVENT:TIMES: expected minutes and seconds of every event")
    begin = parameters.long("TRIAL:ACTUAL_START_FIELD")
    first = int(parameters.header[3]) if begin is None else begin
    seconds = times.reshape(-1, 2) @ (60.0, 1.0) - max(first - 1, 0) / rate
    out = {}
    for label in dict.fromkeys(labels):
        occurrences = np.array([t for name, t in zip(labels, seconds, strict=False) if name == label])
        out[f"EVENT.{label}"] = Variable(f"EVENT.{label}", occurrences.shape, partial(np.copy, occurrences), "s")
    return out
