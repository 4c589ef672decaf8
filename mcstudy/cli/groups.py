"""The two groups of ``mcstudy gap compare``, from its arguments."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from mcstudy.errors import InputError


def groups_of(args: argparse.Namespace) -> list[tuple[Any, str]]:
    """Both groups, each as `mcstudy.compare` takes them, with their names.

    Raises `InputError` for a mixture of descriptions and recordings, and for a condition that is missing or not there.
    """
    from mcstudy.recordings.sheets.frf_group_sheet import is_group

    sides = [
        (args.group, args.condition, "--condition"),
        (args.other or args.group, args.with_condition, "--with-condition"),
    ]
    descriptions = [is_group(path) for paths, _, _ in sides for path in paths]
    if not any(descriptions):
        if not args.other:
            raise InputError("--with: expected the recordings of the second group")
        for _, condition, option in sides:
            if condition is not None:
                raise InputError(f"{option}: expected a description of FRFs (.toml with frf_group), got recordings")
        return [(_recordings(paths, args.data), name) for (paths, _, _), name in zip(sides, ("A", "B"), strict=True)]
    if not all(descriptions) or any(len(paths) > 1 for paths, _, _ in sides):
        raise InputError("groups: expected one description of FRFs for each group, or recordings for both")
    return [_condition(paths[0], condition, option, args.data) for paths, condition, option in sides]


def _recordings(paths: list[Path], data: Path | None) -> list[Any]:
    from mcstudy.recordings.io import read_recording

    return [read_recording(path, data=data) for path in paths]


def _condition(path: Path, condition: str | None, option: str, data: Path | None) -> tuple[Any, str]:
    from mcstudy.recordings.frf_group import read_frf_group

    group = read_frf_group(path, data)
    known = [str(c) for c in group["condition"].values]
    if condition is None and len(known) == 1:
        return group, str(group.attrs["name"])
    if condition not in known:
        got = "none" if condition is None else repr(condition)
        raise InputError(f"{option}: expected a condition of {path}: {'; '.join(known)}; got {got}")
    return group.sel(condition=condition), condition
