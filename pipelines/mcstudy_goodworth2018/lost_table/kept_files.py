"""Arrays that are made once and kept, one file per job, so that a stopped run resumes with the same bits.

A file says from what and by which program its arrays were made; those of another program are made again.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from mcstudy import program
from mcstudy.errors import StoreError
from mcstudy.files.durable import PARTIAL, write
from mcstudy.files.json_files import ensure_folder
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.fan_out import fan_out

MADE_BY = "program"
"""Name of the text in a file that says which program made it."""

J = TypeVar("J")
Arrays = dict[str, np.ndarray]


class Kind(NamedTuple):
    """What the files of a folder hold besides what they were made from: arrays of these names, and where."""

    folder: Path
    names: tuple[str, ...]


def kept(
    kind: Kind,
    jobs: Sequence[J],
    name: Callable[[J], str],
    made_from: Callable[[J], Mapping[str, np.ndarray]],
    make: Callable[[J], Mapping[str, np.ndarray]],
    options: ClusterOptions,
) -> list[Arrays]:
    """Arrays of every job, read where a file of this program holds what they are ``made_from``, else made and written.

    ``name``: of the file of a job. Raises `Interrupted` when stopped; the same call resumes.
    """
    folder = kind.folder
    ensure_folder(folder)
    for left in folder.glob(f"*{PARTIAL}"):
        left.unlink(missing_ok=True)

    made_by = {MADE_BY: np.array(json.dumps(program.maker("mcstudy_goodworth2018"), sort_keys=True))}

    def work(job: J) -> bool:
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **made_by, **made_from(job), **make(job))
        write(folder / name(job), content.getvalue())
        return True

    def held(job: J) -> Arrays | None:
        return _read(folder / name(job), {**made_by, **made_from(job)}, kind.names)

    for _ in fan_out(work, [job for job in jobs if held(job) is None], options, str(folder.parent)):
        pass
    found = [held(job) for job in jobs]
    whole = [arrays for arrays in found if arrays is not None]
    if len(whole) < len(found):
        raise StoreError(f"{folder}: a file changed while it was read; run the same command again")
    return whole


def _read(path: Path, made_from: Mapping[str, np.ndarray], names: Sequence[str]) -> Arrays | None:
    """All arrays of a file; None where it is missing, damaged or made from something else."""
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays = {name: file[name] for name in (*made_from, *names)}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None
    return arrays if all(np.array_equal(arrays[name], x) for name, x in made_from.items()) else None
