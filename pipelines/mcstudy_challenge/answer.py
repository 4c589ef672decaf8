"""``challenge answer``: diagnose every recording of a data folder without the key.

This module imports nothing that simulates cases, and it refuses a folder that holds anything but the listed recordings.
A recording that cannot be diagnosed gets an answer with the reason; it is scored as wrong, not left out.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mcstudy import program
from mcstudy.errors import McstudyError, StoreError, StudyChangedError
from mcstudy.files import json_files, schema
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.fan_out import fan_out
from mcstudy_challenge import files
from mcstudy_challenge.answer_checks import check_answer

Diagnose = Callable[[Recording | FrfRecording], Mapping[str, Any]]
"""Function from a recording to the dictionary of a diagnosis (with its JSON keys)."""

KIND = "challenge_answers"

NEGLIGIBLE = 1e-5
"""Causes with a smaller probability are not written."""


def fast(recording: Recording | FrfRecording) -> Mapping[str, Any]:
    """The shipped diagnosis with its asymptotic statistics."""
    return _diagnosis(recording, fast=True)


def bootstrap(recording: Recording | FrfRecording) -> Mapping[str, Any]:
    """The shipped diagnosis with its bootstrap."""
    return _diagnosis(recording, fast=False)


def _diagnosis(recording: Recording | FrfRecording, fast: bool) -> Mapping[str, Any]:
    from mcstudy.gap.diagnose import diagnose
    from mcstudy.gap.document import document
    from mcstudy.gap.settings import Asked, DiagnosisSettings

    return document(diagnose(recording, DiagnosisSettings(fast=fast, asked=Asked(nearest=False))))


def detect_only(recording: Recording | FrfRecording) -> Mapping[str, Any]:
    """Only the test for a gap, as in `fast`; no cause is named."""
    from mcstudy.gap.diagnose import detect
    from mcstudy.gap.questions.detection import LEVEL
    from mcstudy.gap.settings import FAST

    p_value = detect(recording, FAST).p_value
    return {
        "detected": p_value < LEVEL,
        "p_value": p_value,
        "none_probability": float(p_value >= LEVEL),
        "unknown_probability": float(p_value < LEVEL),
        "causes": [],
        "credible_set": ["none", "unknown"],
    }


METHODS: dict[str, Diagnose] = {"fast": fast, "bootstrap": bootstrap, "detect": detect_only}


def hypothesis_name(entry: Any) -> str:
    """Name of a hypothesis: effects joined by "+", "none" or "unknown"; takes a name, a list of effects, or an entry
    of a diagnosis' credible set."""
    if isinstance(entry, Mapping):
        entry = entry.get("effects") or str(entry["cause"])
    return entry if isinstance(entry, str) else "+".join(sorted(map(str, entry)))


def from_diagnosis(diagnosis: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a diagnosis to an answer of the schema ``challenge_answers``.

    A mislabelled recording is an unknown cause there, because no case is mislabelled.
    """
    wrong = [c for c in diagnosis["causes"] if c.get("advice")]
    mislabelled = {hypothesis_name(c["effects"]) for c in wrong}
    named = (hypothesis_name(e) for e in diagnosis["credible_set"])
    credible = dict.fromkeys("unknown" if n in mislabelled else n for n in named)
    causes = [
        {
            "effects": [str(e) for e in cause["effects"]],
            "group": [str(e) for e in cause["alternatives"][0]] if len(cause["effects"]) == 1 else [],
            "probability": float(cause["probability"]),
            "size": _sizes(cause.get("size") or {}),
        }
        for cause in diagnosis["causes"]
        if float(cause["probability"]) > NEGLIGIBLE and not cause.get("advice")
    ]
    return {
        "detected": bool(diagnosis["detected"]),
        "p_value": float(diagnosis["p_value"]),
        "none_probability": float(diagnosis["none_probability"]),
        "unknown_probability": float(diagnosis["unknown_probability"]) + sum(float(c["probability"]) for c in wrong),
        "causes": causes,
        "credible_set": list(credible),
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
    """The interval of the share of the gap that the leading cause closes; None when there is none."""
    if not closed or not causes or any(closed.get(k) is None for k in ("fraction", "low", "high")):
        return None
    return {
        "effects": hypothesis_name(causes[0]["effects"]),
        **{k: float(closed[k]) for k in ("fraction", "low", "high")},
    }


def answer(
    data: Path,
    out: Path,
    diagnose: Diagnose,
    method: str,
    options: ClusterOptions | None = None,
) -> str:
    """Diagnose all recordings without an answer and write all answers; returns their SHA-256.

    Raises
    ------
    StoreError: the folder is not that of a challenge, is incomplete, holds other files than recordings (for example a
        key), or a recording has changed.
    StudyChangedError: there are answers to other data, by another method or by another program.
    Interrupted: stopped; the same call resumes.
    """
    data, out = data.resolve(), out.resolve()
    manifest, sha = files.read_manifest(data)
    header = {"manifest_sha256": sha, "method": method, "program": program.maker("mcstudy_challenge")}
    if out.is_relative_to(data):
        raise StudyChangedError(f"{out}: expected answers outside the data folder {data}")
    done = _resumed(out, header)
    names = [Path(n).stem for n in manifest["files"]]
    for name in (n for n in names if n not in done):
        if json_files.digest(data / f"{name}.nc") != manifest["files"][f"{name}.nc"]:
            raise StoreError(f"{data / name}.nc: expected the recording whose SHA-256 the manifest has, found another")

    def one(name: str) -> dict[str, Any]:
        begun = time.perf_counter()
        try:
            given = from_diagnosis(diagnose(read_recording(data / f"{name}.nc")))
            _check({"name": name, "seconds": 0.0, **given}, "answer")
        except McstudyError as error:
            given = {"error": " ".join(str(error).split())}
        except Exception as error:  # an error in one recording must not stop the others
            given = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
        return {"name": name, "seconds": round(time.perf_counter() - begun, 3), **given}

    json_files.ensure_folder(files.partial_folder(out))
    for name, given in fan_out(one, [n for n in names if n not in done], options or ClusterOptions(), str(data)):
        done[name] = header | {"answer": given}
        files.write_part(out, KIND, header, given)
    answers = {
        "schema": schema.identifier(KIND),
        "challenge": manifest["challenge"],
        **header,
        "answers": [done[n]["answer"] for n in names],
    }
    result = json_files.write_json(out, answers, KIND)
    files.drop_parts(out)
    return result


def answered(data: Path, out: Path, method: str) -> bool:
    """Whether ``out`` holds all answers to the data by this method and this program.

    Raises `StudyChangedError` where it holds others.
    """
    if not out.exists():
        return False
    _, sha = files.read_manifest(data)
    _same(
        out,
        files.read_answers(out),
        {"manifest_sha256": sha, "method": method, "program": program.maker("mcstudy_challenge")},
    )
    return True


def _same(path: Path, held: Mapping[str, Any], header: Mapping[str, Any]) -> None:
    """Raise `StudyChangedError`, one line, unless answers in ``path`` are of this header."""
    why = ""
    if held.get("manifest_sha256") != header["manifest_sha256"]:
        why = "they are answers to other data"
    elif held.get("method") != header["method"]:
        why = f"they are answers of the method {str(held.get('method'))[:60]!r}, expected {header['method']!r}"
    else:
        why = program.other_maker(held.get("program"), header["program"])
    if why:
        raise StudyChangedError(
            f"{path}: {why}; to answer again, remove it or choose another place; whole answers can be scored as they "
            "are: mcstudy gap challenge score"
        )


def _resumed(out: Path, header: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Existing answers, without those that cannot be scored."""
    done = {}
    for name, part in files.read_parts(out, KIND).items():
        _same(files.partial_folder(out), part, header)
        with contextlib.suppress(StoreError):
            check_answer(part["answer"], name)
            done[name] = part
    return done


def _check(given: Mapping[str, Any], where: str) -> None:
    """Check answers one by one, so that one invalid answer does not invalidate the file."""
    schema.validate(KIND, given, where, ("properties", "answers", "items"))
    check_answer(given, where)
