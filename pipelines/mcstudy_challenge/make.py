"""``challenge make``: simulate recordings into one folder and write their truth to a separate key."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy import program
from mcstudy.errors import StoreError, StudyChangedError
from mcstudy.files import json_files, schema
from mcstudy.files.durable import PARTIAL, sync_folder
from mcstudy.files.output import write_file
from mcstudy.recordings.formats.netcdf_zarr import netcdf_bytes, to_dataset
from mcstudy.recordings.recording import Recording
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.fan_out import fan_out
from mcstudy_challenge import files
from mcstudy_challenge.bodies.draws import check_visible
from mcstudy_challenge.cases import Case, list_cases
from mcstudy_challenge.design import ChallengeFile
from mcstudy_challenge.truth import make_case

KIND = "challenge_key"

RESOLUTION = 2.0**-36
"""Resolution of the recorded channels (rad, N m): far below any noise; it makes the files a third smaller."""


def write_case(recording: Recording, path: Path) -> str:
    """Write a recording as compressed NetCDF, atomically; returns its SHA-256."""
    dataset = to_dataset(recording)
    for name in ("stimulus", "theta"):
        dataset[name].values = np.round(dataset[name].values / RESOLUTION) * RESOLUTION
    packed: dict[str, Any] = {"zlib": True, "complevel": 1, "shuffle": True}
    content = netcdf_bytes(dataset, {"stimulus": packed, "theta": packed})
    write_file(path, lambda: content)
    return hashlib.sha256(content).hexdigest()


def make(file: ChallengeFile, data: Path, key: Path, options: ClusterOptions | None = None) -> str:
    """Simulate every case that does not exist yet; returns the SHA-256 of the key.

    Raises
    ------
    DesignError: no effect of a series is detectable in its recordings.
    StoreError: the key would lie inside the data folder, or a folder cannot be written.
    StudyChangedError: the folder belongs to another challenge, or was made by another program.
    Interrupted: stopped; the same call resumes.
    """
    data, key = data.resolve(), key.resolve()
    if key.is_relative_to(data):
        raise StoreError(f"{key}: expected a key outside the data folder {data}")
    if (data / files.MANIFEST).exists():
        manifest, _ = files.read_manifest(data)
        if manifest["fingerprint"] != file.fingerprint:
            raise StudyChangedError(f"{data}: made from another challenge file; expected a new folder")
        if why := program.other_maker(manifest.get("program"), program.maker("mcstudy_challenge")):
            raise StudyChangedError(
                f"{data}: {why}; expected a new folder; these recordings can be answered and scored as they are: "
                "mcstudy gap challenge answer, score"
            )
        if not key.exists() or json_files.digest(key) != manifest["key_sha256"]:
            raise StoreError(f"{key}: expected the key that {data / files.MANIFEST} names")
        return str(manifest["key_sha256"])
    for strange in sorted(data.iterdir()) if data.is_dir() else ():
        if not files.CASE.fullmatch(strange.stem) and strange.suffix != PARTIAL:
            raise StoreError(f"{strange}: expected a new folder, or only the recordings of this challenge")
    check_visible(file)
    cases = list_cases(file)
    json_files.ensure_folder(data)
    json_files.ensure_folder(files.partial_folder(key))
    made_by = {"fingerprint": file.fingerprint, "program": program.maker("mcstudy_challenge")}
    done = {
        name: part
        for name, part in files.read_parts(key, KIND).items()
        if made_by.items() <= part.items() and _is(data / f"{name}.nc", part.get("sha256"))
    }

    def one(case: Case) -> dict[str, Any]:
        recording, truth = make_case(file, case)
        part = made_by | {"sha256": write_case(recording, data / f"{case.name}.nc")}
        files.write_part(key, KIND, part, truth)
        return part | {"truth": truth}

    for case, part in fan_out(one, [c for c in cases if c.name not in done], options or ClusterOptions(), str(data)):
        done[case.name] = part
    return _finish(file, data, key, cases, done)


def _is(recording: Path, sha: object) -> bool:
    """Whether a recording exists unchanged."""
    return recording.is_file() and json_files.digest(recording) == sha


def _finish(file: ChallengeFile, data: Path, key: Path, cases: list[Case], done: dict[str, dict[str, Any]]) -> str:
    truth = {
        "schema": schema.identifier(KIND),
        "challenge": file.challenge.name,
        "fingerprint": file.fingerprint,
        "design": file.model_dump(mode="json", exclude={"answer"}),
        "cases": [done[c.name]["truth"] for c in cases],
    }
    sha = json_files.write_json(key, truth, KIND)
    recordings = {f"{c.name}.nc": str(done[c.name]["sha256"]) for c in cases}
    manifest = {
        "schema": schema.identifier("challenge_manifest"),
        "challenge": file.challenge.name,
        "description": "Recordings of bodies with hidden causes; diagnose each recording, then score the answers.",
        "fingerprint": file.fingerprint,
        "program": next(iter(done.values()))["program"],
        "key_sha256": sha,
        "files": recordings,
    }
    for leftover in data.glob(f"*{PARTIAL}"):
        leftover.unlink(missing_ok=True)
    sync_folder(data)
    json_files.write_json(data / files.MANIFEST, manifest, "challenge_manifest")
    files.drop_parts(key)
    return sha
