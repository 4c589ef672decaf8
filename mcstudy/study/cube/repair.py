"""Repair of the metadata and coordinates of a cube: they are made again from its study and replace damaged files.

Everything in a cube except its results follows from the study, the environments it was made in, and the number of
realizations per chunk. The study is given, the environments are stored redundantly (`identity`), and the number is in
attributes and arrays. What was only rounded otherwise in another environment is left as it is (`rounding`).
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcstudy.errors import StoreError
from mcstudy.files import schema
from mcstudy.files.durable import sync_folder, unwritable, write
from mcstudy.files.unfinished import scratch_folder
from mcstudy.files.untrusted import refuse_links
from mcstudy.study.cube import identity
from mcstudy.study.cube.layout import realizations_a_chunk
from mcstudy.study.cube.metadata import depth_votes, own_document
from mcstudy.study.cube.rounding import alike
from mcstudy.study.cube.store import SCHEMA, Cube
from mcstudy.study.cube.strays import NOT_PART, parts, set_aside, strays
from mcstudy.study.design import Study
from mcstudy.study.environment import environment, label


@dataclass
class Repairs:
    """Repairs made to a cube before a run.

    Attributes
    ----------
    written: metadata and coordinate files that were written again.
    said: one line for each file that was set aside, or that does not belong to the cube and was left.
    """

    written: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)


def skeleton(cube: Cube, made_in: dict[str, Any], others: dict[str, dict[str, Any]]) -> dict[Path, bytes]:
    """Every file of an empty cube of the same study and depths, made in an environment: relative path and content.

    ``others``: further environments that its chunks name, by label.
    """
    with scratch_folder("mcstudy-fresh-") as folder:
        older = [name for name, group in cube.groups.items() if group.older]
        fresh = Cube.create(folder / "fresh", cube.study, made_in, cube.depths, others, older)
        return {p.relative_to(fresh.path): p.read_bytes() for p in fresh.path.rglob("*") if p.is_file()}


OURS = "mcstudy:"
"""What the names of all schemas begin with."""


def refuse_part(path: Path) -> None:
    """Raise `StoreError` when ``path`` is in a cube, or is one group of a cube: no cube can be there."""
    for folder in path.parents:
        attributes = {}
        with contextlib.suppress(StoreError):
            attributes = own_document(folder).get("attributes", {})
        if str(attributes.get("schema")).startswith(OURS) or "fingerprint" in attributes:
            raise StoreError(f"{path}: expected a place of its own, found one inside the results cube {folder}")
    if (path / "status" / "zarr.json").exists():
        raise StoreError(f"{path}: expected a results cube, found one group of one")


def note_environment(cube: Cube, environment: dict[str, Any]) -> None:
    """Store an environment in the root of a cube, durably, before chunks name it; `StoreError` if it cannot be."""
    made_in, name = cube.attributes["environment"], label(environment)
    others = dict(cube.attributes.get("environments", {}))
    if name in (*others, label(made_in)):
        return
    others[name] = environment
    root = cube.path / "zarr.json"
    try:
        write(root, skeleton(cube, made_in, others)[Path(root.name)])
        sync_folder(cube.path)
    except OSError as error:
        raise StoreError(f"{root}: expected a writable file ({error.strerror})") from None
    cube.attributes["environments"] = others


def repairable(path: Path, study: Study) -> bool:
    """Whether a cube that cannot be opened belongs to this study and can be repaired."""
    with contextlib.suppress(StoreError):
        schema_name = own_document(path).get("attributes", {}).get("schema")
        if isinstance(schema_name, str) and schema_name.startswith(OURS) and schema_name != schema.identifier(SCHEMA):
            return False  # another version is not damage
    return identity.fingerprint_of(path) == study.fingerprint and identity.made_in(path) is not None


def repair(path: Path, study: Study, quarantine: bool = False) -> tuple[Cube, Repairs]:
    """Repair the damaged metadata and coordinate files of the study's cube at ``path``; returns cube and repairs.

    Anything that blocks the path of a file or folder of the cube is set aside; with ``quarantine``, every file that
    does not belong to the cube is.
    """
    refuse_links(path)
    made_in = identity.made_in(path)
    if made_in is None:
        raise StoreError(f"{path}: attribute environment: expected the environment the cube was made in")
    votes = depth_votes(path)
    depths = {name: votes.get(name, realizations_a_chunk(group)) for name, group in study.groups.items()}
    cube = Cube(path, study, {"environment": made_in}, depths)
    files, elsewhere = skeleton(cube, made_in, identity.environments(path)), made_in != environment()
    repairs = Repairs()
    stray_files = list(strays(path, parts(cube, files)))
    leaving = [stray for stray in stray_files if quarantine or stray.in_the_way]
    left = [stray.path for stray in stray_files if stray not in leaving]
    for stray in left:
        if (path / stray).is_dir():  # Zarr would take it for a group or an array
            raise StoreError(f"{path / stray}: {NOT_PART}")
    if leaving:
        place = set_aside(path, leaving)
        repairs.said += [f"set aside: {stray.path.as_posix()} is now in {place}" for stray in leaving]
    repairs.said += [f"warning: {path / stray}: {NOT_PART}" for stray in left]
    for file, content in files.items():
        target = path / file
        held = target.read_bytes() if target.is_file() else b""
        if held != content and not (elsewhere and alike(cube, file, content, held)):
            try:
                for folder in reversed(target.relative_to(path).parents):
                    (path / folder).mkdir(exist_ok=True)
                write(target, content)
                sync_folder(target.parent)
            except OSError as error:
                raise unwritable(target, "a writable file", error) from None
            repairs.written.append(file.as_posix())
    return Cube.open(path), repairs
