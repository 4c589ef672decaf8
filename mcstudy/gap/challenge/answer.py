"""``challenge answer``: every recording of a data folder diagnosed, without the key.

Nothing here imports what makes cases, and a folder that holds anything but the listed recordings is refused. A
recording that cannot be diagnosed gets an answer that says why: it is scored as wrong, not left out.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcstudy.errors import McstudyError, StoreError, StudyChangedError
from mcstudy.gap.challenge import files
from mcstudy.gap.challenge.answer_checks import check_answer
from mcstudy.gap.challenge.fanout import fan_out
from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.read import read_recording
from mcstudy.gap.recording import Recording
from mcstudy.study import schema
from mcstudy.study.cluster import ClusterOptions

Diagnose = Callable[[Recording | FrfRecording], Mapping[str, Any]]
"""From a recording to the dictionary of a diagnosis (its JSON keys)."""

KIND = "challenge_answers"

NEGLIGIBLE = 1e-5
"""Causes less probable than this are not written."""


def fast(recording: Recording | FrfRecording) -> Mapping[str, Any]:
    """The shipped diagnosis with its asymptotic statistics."""
    from mcstudy.gap.diagnose import diagnose_fast

    return diagnose_fast(recording).to_dict()


def bootstrap(recording: Recording | FrfRecording) -> Mapping[str, Any]:
    """The shipped diagnosis with its bootstrap."""
    from mcstudy.gap.diagnose import diagnose

    return diagnose(recording).to_dict()


def detect(recording: Recording | FrfRecording) -> Mapping[str, Any]:
    """Only whether there is a gap, as `fast` decides it; a cause is never named."""
    from mcstudy.gap.diagnose import LEVEL, detect_fast

    p_value = detect_fast(recording).p_value
    return {
        "detected": p_value < LEVEL,
        "p_value": p_value,
        "none_probability": float(p_value >= LEVEL),
        "unknown_probability": float(p_value < LEVEL),
        "causes": [],
        "credible_set": ["none", "unknown"],
    }


METHODS: dict[str, Diagnose] = {"fast": fast, "bootstrap": bootstrap, "detect": detect}


def label(entry: Any) -> str:
    """Name of a hypothesis: effects joined by "+", "none" or "unknown"; takes a name, a list of effects, or an entry
    of a diagnosis' credible set."""
    if isinstance(entry, Mapping):
        entry = entry.get("effects") or str(entry["cause"])
    return entry if isinstance(entry, str) else "+".join(sorted(map(str, entry)))


def from_diagnosis(diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    """The answer that a diagnosis gives, as the schema ``challenge_answers`` describes one."""
    causes = [
        {
            "effects": [str(e) for e in cause["effects"]],
            "group": [str(e) for e in cause["alternatives"][0]] if len(cause["effects"]) == 1 else [],
            "probability": float(cause["probability"]),
            "size": _sizes(cause.get("size") or {}),
        }
        for cause in diagnosis["causes"]
        if float(cause["probability"]) > NEGLIGIBLE
    ]
    return {
        "detected": bool(diagnosis["detected"]),
        "p_value": float(diagnosis["p_value"]),
        "none_probability": float(diagnosis["none_probability"]),
        "unknown_probability": float(diagnosis["unknown_probability"]),
        "causes": causes,
        "credible_set": [label(e) for e in diagnosis["credible_set"]],
        "place": {k: float(v) for k, v in (diagnosis.get("place") or {}).items()},
        "closed": _closed(diagnosis.get("closed"), diagnosis["causes"]),
    }


def _sizes(sizes: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    return {
        str(name): {"value": float(s["estimate"]), "low": float(s["low"]), "high": float(s["high"])}
        for name, s in sizes.items()
        if all(s.get(k) is not None for k in ("estimate", "low", "high"))
    }


def _closed(closed: Mapping[str, Any] | None, causes: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """The interval of the gap that the leading cause closes, None when there is none."""
    if not closed or not causes or any(closed.get(k) is None for k in ("fraction", "low", "high")):
        return None
    return {"effects": label(causes[0]["effects"]), **{k: float(closed[k]) for k in ("fraction", "low", "high")}}


def answer(
    data: Path,
    out: Path,
    diagnose: Diagnose,
    method: str,
    options: ClusterOptions | None = None,
) -> str:
    """Diagnose what has no answer yet and write all answers; returns their SHA-256.

    Raises
    ------
    StoreError: the folder is not a challenge's, is not whole, holds more than recordings (a key, for one), or a
        recording is not the one that was made.
    StudyChangedError: parts of answers to other data, or by another method, are in the way.
    Interrupted: stopped; the same call resumes.
    """
    data, out = data.resolve(), out.resolve()
    manifest, sha = files.read_manifest(data)
    if out.is_relative_to(data):
        raise StudyChangedError(f"{out}: expected answers outside the data folder {data}")
    done = _resumed(out, sha, method)
    names = [Path(n).stem for n in manifest["files"]]
    for name in (n for n in names if n not in done):
        if files.digest(data / f"{name}.nc") != manifest["files"][f"{name}.nc"]:
            raise StoreError(f"{data / name}.nc: expected the recording whose SHA-256 the manifest has, found another")

    def one(name: str) -> dict[str, Any]:
        begun = time.perf_counter()
        try:
            given = from_diagnosis(diagnose(read_recording(data / f"{name}.nc")))
            _check({"name": name, "seconds": 0.0, **given}, "answer")
        except McstudyError as error:
            given = {"error": " ".join(str(error).split())}
        except Exception as error:  # one recording's trouble must not cost the others their answers
            given = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
        return {"name": name, "seconds": round(time.perf_counter() - begun, 3), **given}

    files.make_folder(files.partial_folder(out))
    header = {"manifest_sha256": sha, "method": method}
    for name, given in fan_out(one, [n for n in names if n not in done], options or ClusterOptions(), str(data)):
        done[name] = header | {"answer": given}
        files.write_part(out, KIND, header, given)
    answers = {
        "schema": schema.identifier(KIND),
        "challenge": manifest["challenge"],
        **header,
        "answers": [done[n]["answer"] for n in names],
    }
    result = files.write_json(out, answers, KIND)
    files.drop_parts(out)
    return result


def _resumed(out: Path, sha: str, method: str) -> dict[str, dict[str, Any]]:
    """Answers that are there already, those that cannot be scored left out."""
    done = {}
    for name, part in files.read_parts(out, KIND).items():
        if part.get("manifest_sha256") != sha or part.get("method") != method:
            folder = files.partial_folder(out)
            raise StudyChangedError(f"{folder}: answers to other data or by another method; remove the folder")
        with contextlib.suppress(StoreError):
            check_answer(part["answer"], name)
            done[name] = part
    return done


def _check(given: Mapping[str, Any], where: str) -> None:
    """Answers are checked one by one, so that one that cannot be scored does not stop the file."""
    schema.validate(KIND, given, where, ("properties", "answers", "items"))
    check_answer(given, where)
