"""Files as laboratories have them, written by other libraries than those that read them, or by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import c3d
import h5py
import numpy as np


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
) -> None:
    """Points (n, 3), nan where not seen, and channels (k n,) of k samples per frame; events in s."""
    count = len(next(iter(points.values()))) if points else len(next(iter(analog.values())))
    per_frame = len(next(iter(analog.values()))) // count if analog else 1
    writer = c3d.Writer(point_rate=rate_hz, analog_rate=rate_hz * per_frame, point_units=units)
    for k in range(count):
        frame = np.zeros((len(points), 5), np.float32)
        for j, values in enumerate(points.values()):
            seen = np.isfinite(values[k]).all()
            frame[j, :3], frame[j, 3] = (values[k] if seen else 0.0), (0.0 if seen else -1.0)
        channels = np.array([v[k * per_frame : (k + 1) * per_frame] for v in analog.values()]).reshape(-1, per_frame)
        pair = np.empty((1, 2), object)
        pair[0, 0], pair[0, 1] = frame, channels
        writer.add_frames(pair)
    writer.set_point_labels(list(points))
    writer.set_analog_labels(list(analog) or ["none"])
    if angles:
        width = max(map(len, angles))
        writer.point_group.add_str("ANGLES", "", "".join(a.ljust(width) for a in angles), width, len(angles))
        writer.point_group.add_str("ANGLE_UNITS", "", "deg", 3)
    if analog_units:
        width = max(map(len, analog_units))
        text = "".join(u.ljust(width) for u in analog_units)
        writer.analog_group.add_str("UNITS", "", text, width, len(analog_units))
    if events:
        labels = [name for name, times in events.items() for _ in times]
        times = [t for own in events.values() for t in own]
        width = max(map(len, labels))
        group = writer.add_group(20, "EVENT", "")
        group.add_str("LABELS", "", "".join(n.ljust(width) for n in labels), width, len(labels))
        group.add_array("TIMES", "", np.array([[t // 60, t % 60] for t in times], np.float32))
    with path.open("wb") as file:
        writer.write(file)


def write_mat73(path: Path, variables: Mapping[str, Any]) -> None:
    """MATLAB's layout of HDF5: arrays reversed, structs as groups, struct arrays (lists of dicts) and cells (lists of
    arrays) by reference, with the attributes and the header that MATLAB writes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")

        def put(group: h5py.Group, name: str, value: Any) -> h5py.HLObject:
            if isinstance(value, Mapping):
                made = group.create_group(name)
                made.attrs["MATLAB_class"] = np.bytes_("struct")
                for key, inner in value.items():
                    put(made, key, inner)
                return made
            if isinstance(value, list) and value and isinstance(value[0], Mapping):
                made = group.create_group(name)
                made.attrs["MATLAB_class"] = np.bytes_("struct")
                for key in value[0]:
                    fields = [put(refs, f"r{len(refs)}", element[key]).ref for element in value]
                    made.create_dataset(key, data=np.array(fields, h5py.ref_dtype)[:, None], dtype=h5py.ref_dtype)
                return made
            if isinstance(value, list):
                cells = [put(refs, f"r{len(refs)}", element).ref for element in value]
                made = group.create_dataset(name, data=np.array(cells, h5py.ref_dtype)[:, None], dtype=h5py.ref_dtype)
                made.attrs["MATLAB_class"] = np.bytes_("cell")
                return made
            if isinstance(value, str):
                made = group.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), "u2")[:, None])
                made.attrs["MATLAB_class"] = np.bytes_("char")
                return made
            made = group.create_dataset(name, data=np.atleast_2d(value).T, compression="gzip")
            made.attrs["MATLAB_class"] = np.bytes_("double")
            return made

        for name, value in variables.items():
            put(file, name, value)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\0\2IM")
