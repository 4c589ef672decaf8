"""Files as laboratories have them, written by other libraries than those that read them, or by hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np


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
