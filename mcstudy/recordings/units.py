"""Units: conversion factors to those used internally (rad, s, N m, m), and what a file may state against a declaration.

A unit is declared by the user or stated by the file; where both speak they must agree. A file that states a unit of
another kind - volts, millimetres, degrees per second - does not hold what is asked for, whatever was declared.
"""

from __future__ import annotations

import math
import re

from mcstudy.errors import RecordingError
from mcstudy.recordings.refusals import require_known

FACTORS: dict[str, dict[str, float]] = {
    "rad": {
        "rad": 1.0,
        "mrad": 1e-3,
        "deg": math.pi / 180,
        "°": math.pi / 180,
        "arcmin": math.pi / 10_800,
        "gon": math.pi / 200,
    },
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0},
    "N m": {
        "N m": 1.0,
        "N mm": 1e-3,
        "N cm": 1e-2,
        "mN m": 1e-3,
        "kN m": 1e3,
        "kgf m": 9.80665,
        "kgf cm": 9.80665e-2,
        "lbf ft": 1.3558179483314004,
        "lbf in": 0.1129848290276167,
    },
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
}
"""Units per target; a kilogram-force is 9.80665 N (CGPM 1901), a pound 0.45359237 kg, a foot 0.3048 m (1959)."""

KINDS = {"rad": "an angle", "s": "a time", "N m": "a torque", "m": "a length"}
"""What each target measures."""

OTHERS = {
    "a voltage": ("V", "mV", "uV", "volt", "volts"),
    "a current": ("A", "mA"),
    "a force": ("N", "kN", "kgf", "newton", "newtons"),
    "a mass": ("kg",),
    "an acceleration": ("g",),
    "a frequency": ("Hz", "kHz"),
    "a share": ("%", "percent"),
    "a level": ("dB",),
    "a power": ("W",),
    "an energy": ("J",),
    "a pressure": ("Pa", "kPa", "hPa"),
    "a temperature": ("°C", "degC"),
    "a count": ("counts", "count", "samples", "frames", "frame", "px", "pixel", "pixels", "bit", "bits"),
}
"""Units of other kinds, which files of laboratories state."""

_WORDS = {
    "rad": ("radian", "radians", "rads"),
    "deg": ("degree", "degrees", "degs", "º"),
    "s": ("sec", "secs", "second", "seconds"),
    "ms": ("msec", "millisecond", "milliseconds"),
    "min": ("minute", "minutes"),
    "N m": ("newtonmeter", "newtonmeters", "newtonmetre", "newtonmetres"),
    "lbf ft": ("lbft", "ftlb", "ftlbf", "ftlbs", "footpounds"),
    "lbf in": ("lbin", "inlb", "inlbf", "inlbs", "inchpounds"),
    "m": ("meter", "meters", "metre", "metres"),
    "cm": ("centimeter", "centimeters", "centimetre", "centimetres"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
}
"""Other words for a unit."""

_ENDING = re.compile(
    r"(?:.+_(?P<unit>°|deg|degs|degree|degrees|rad|radian|radians|mrad|N_?mm?|mm|mV)(?P<rate>_(?:per_)?s(?:2|ec)?)?"
    r"|(?:t|time)_(?P<time>s|ms|us|sec))",
    re.IGNORECASE,
)
"""A unit at the end of a name. ``_m``, ``_s``, ``_cm`` are none: they also mean measured, smoothed, centre of mass."""

_SEPARATOR = re.compile(r"\s*[/,]\s*|\s+in\s+|\s*:\s+|[\s.]+")
"""What stands between a name and its unit, as in ``moment / N m``, ``"angle, deg"``, ``knee angle deg``."""

_CLEAR = re.compile(r"/|,|in")
"""Separators behind which any unit is one; behind a blank, a dot or a colon, single letters are parts of names."""

_PER_TIME = re.compile(r"(?P<over>.+?)(?:\^?[-−](?P<power>[12])|⁻(?P<raised>[¹²]))")
"""A unit with a negative power of a second at its end, ``deg s-1``."""


def as_shown(unit: str) -> tuple[float, str]:
    """Factor and unit in which people read values: deg for rad, else the unit itself."""
    return (180 / math.pi, "deg") if unit == "rad" else (1.0, unit)


def _bare(unit: str) -> str:
    """A spelling without blanks, dots and hyphens between its parts: N·m, N.m, N-m and N*m are Nm."""
    return re.sub(r"[\s·⋅∙×*._-]", "", unit.strip().strip("[](){}")).replace("µ", "u").replace("μ", "u")


_SPELLED = {_bare(unit): unit for units in FACTORS.values() for unit in units}
_SPELLED |= {word: unit for unit, words in _WORDS.items() for word in words}
_TARGET = {unit: target for target, units in FACTORS.items() for unit in units}
_OTHER = {_bare(unit): kind for kind, units in OTHERS.items() for unit in units}


def _spelled(unit: str) -> str | None:
    """The unit as `FACTORS` spells it; capital letters count only where they tell units apart (mN m, Nm)."""
    bare = _bare(unit)
    spelled = _SPELLED.get(bare)
    if spelled is None and len(bare) > 1 and bare.lower() not in ("nm", "mnm", "knm"):
        spelled = _SPELLED.get(bare.lower())
    return spelled


def kind_of(unit: str | None) -> str | None:
    """What a unit measures, in words; None for text that is no known unit, and for none."""
    if unit is None:
        return None
    if (spelled := _spelled(unit)) is not None:
        return KINDS[_TARGET[spelled]]
    if (other := _OTHER.get(_bare(unit)) or _OTHER.get(_bare(unit).lower())) is not None:
        return other
    if (power := _PER_TIME.fullmatch(unit.strip().strip("[](){}"))) is not None and power["over"].endswith("s"):
        over = power["over"][:-1].rstrip(" ·⋅*.")
        return f"{kind_of(over)} per s" if kind_of(over) else None
    over, slash, under = unit.strip().strip("[](){}").partition("/")
    if slash and kind_of(over) and kind_of(re.sub(r"\^?-?\d$|²$", "", under)):
        return f"{kind_of(over)} per {_bare(under)}"
    return None


def factor(unit: str, target: str, where: str) -> float:
    """Factor that converts values in ``unit`` to ``target``; `RecordingError` names ``where``.

    ``target``: one of `FACTORS`, or the unit that a model declares; one that is not known here is only equal to itself.
    """
    spelled = _spelled(unit)
    if target not in FACTORS:
        kind = _TARGET.get(_spelled(target) or "")
        if kind is not None:
            return factor(unit, kind, where) / factor(target, kind, where)
        require_known(unit, (target,), f"{where}: unit")
        return 1.0
    if spelled not in FACTORS[target]:
        require_known(unit, FACTORS[target], f"{where}: unit")
    return FACTORS[target][spelled or unit]


def agreed(declared: str | None, stated: str | None, target: str, where: str, name: str) -> str | None:
    """The unit of a variable ``name``: declared by the user, or stated by its file; None where neither speaks.

    ``target``: the unit that its kind is converted to. Raises `RecordingError`, naming ``where``, for a file that
    states a unit of another kind, or of the same kind but not the declared one; text that is no unit states nothing.
    """
    kind, wanted = kind_of(stated), kind_of(target)
    if kind is not None and wanted is not None and kind != wanted:
        raise RecordingError(
            f"{where}: unit: expected {wanted}, but the file states {stated} ({kind}) for {name}; name another "
            "variable, or state that its units are wrong (units.stated, --stated-units ignored)"
        )
    if kind is None or stated is None:
        return declared
    if declared is not None and factor(declared, target, where) != factor(stated, target, where):
        raise RecordingError(
            f"{where}: unit: declared {declared}, but the file states {stated} for {name}; leave the unit out, or "
            "state that those of the file are wrong (units.stated, --stated-units ignored)"
        )
    return declared or stated


def at_end(name: str) -> str | None:
    """The unit at the end of a column's name, ``theta1_deg``, ``theta1 / deg``; None where there is none."""
    for sign in _SEPARATOR.finditer(name):
        unit = name[sign.end() :]
        clear = _CLEAR.fullmatch(sign[0].strip()) is not None
        if sign.start() > 0 and (clear or len(unit) > 1 or unit in "°º") and kind_of(unit) is not None:
            return unit
    ending = _ENDING.fullmatch(name)
    if ending is None:
        return None
    if ending["time"]:
        return ending["time"]
    unit = ending["unit"].replace("_", "")
    if ending["rate"]:
        return f"{unit}/s^2" if ending["rate"].endswith("2") else f"{unit}/s"
    return unit if kind_of(unit) else None
