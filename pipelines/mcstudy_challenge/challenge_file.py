"""Reading challenge files.

A challenge file is TOML. Sections at the top level apply to the main benchmark. ``[variant.NAME]`` adds a series with
its own cases and may override single keys of any section (``[variant.NAME.noise]``). By default the cases of a variant
have no missing effect, so it measures false alarms. Every mistake gives one line: ``file: field: what was expected``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcstudy.errors import DesignError
from mcstudy.files.plain_errors import short, shown, validated
from mcstudy.study.catalogue import read_file
from mcstudy.study.study_file import check_tables, merge
from mcstudy_challenge.design import KINDS, MAIN, SECTIONS, Answering, Challenge, ChallengeFile, Series
from mcstudy_challenge.design_checks import check_series


def read_challenge(path: str | Path) -> ChallengeFile:
    """The resolved challenge of a file, or of a shipped one by name; raises `DesignError` with one line."""
    return read_file(path, "challenge", resolve)


def resolve(raw: dict[str, Any]) -> ChallengeFile:
    """The challenge of a parsed file; the one-line `DesignError` starts with the field."""
    check_tables(raw, ("challenge", "answer", *SECTIONS, "variant"))
    if "challenge" not in raw:
        raise DesignError("challenge: missing, expected a table [challenge] with name, seed and cases")
    challenge = validated(Challenge, raw["challenge"], "challenge")
    answer = validated(Answering, raw.get("answer", {}), "answer")
    shared = {k: raw[k] for k in SECTIONS if k in raw}
    for key, value in shared.items():
        validated(Series.model_fields[key].annotation, value, key)
    series = {MAIN: _series({"cases": challenge.cases, **shared}, "")}
    for name, own in raw.get("variant", {}).items():
        where = f"variant.{shown(name)}"
        if name == MAIN or not isinstance(own, dict):
            raise DesignError(f"{where}: expected a table [variant.NAME] with another name than {MAIN}")
        for key in SECTIONS:
            if not isinstance(own.get(key, {}), dict):
                raise DesignError(f"{where}.{key}: expected a table, got {short(own[key])}")
        inherited = {k: v for k, v in shared.items() if k != "mix"}
        mix = own.get("mix", {k: float(k == "none") for k in KINDS})
        series[name] = _series({**merge(inherited, own), "mix": mix}, where)
    sections = {"challenge": challenge, "answer": answer}
    plain: dict[str, Any] = {k: v.model_dump(mode="json") for k, v in sections.items()}
    return resolved({**plain, "series": {k: s.model_dump(mode="json") for k, s in series.items()}})


def resolved(plain: dict[str, Any], where: str = "") -> ChallengeFile:
    """The fully resolved challenge stored in a key; `DesignError` starts with the field."""
    file: ChallengeFile = validated(ChallengeFile, plain, where)
    for name, series in file.series.items():
        _checked(series, f"{where}.series.{name}" if where else "" if name == MAIN else f"variant.{name}")
    if MAIN not in file.series:
        raise DesignError(f"{where or 'file'}: series: expected one that is called {MAIN}")
    return file


def _series(plain: dict[str, Any], where: str) -> Series:
    series: Series = validated(Series, plain, where)
    return series


def _checked(series: Series, where: str) -> None:
    try:
        check_series(series)
    except DesignError as error:
        raise DesignError(f"{where}.{error}" if where else str(error)) from None
