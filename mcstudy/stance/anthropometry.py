"""Masses, heights and inertias of legs and upper body from a person's height and mass, by published tables.

Two tables give each segment's share of the body's mass, its centre of mass and its radius of gyration:

``winter``
    Winter (2009), Biomechanics and Motor Control of Human Movement, 4th ed., Table 4.1 (after Dempster 1955), with the
    segment lengths of Drillis & Contini (1966), Winter's Fig. 4.1. One table for everybody.
``deleva``
    de Leva (1996), J Biomech 29:1223-1230, Table 4 (after Zatsiorsky & Seluyanov): young men and women. Lengths are
    those of the mean man (1.741 m) or woman (1.735 m), scaled with height.

The legs are both thighs and shanks, from ankle to hip; the feet stand still and are left out. The upper body is head,
arms (hanging) and trunk. All centres of mass lie on one vertical line.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mcstudy.errors import ModelError
from mcstudy.stance.ranges import Range

HEIGHT_M = Range(0.5, 2.6, "m")
"""Body heights."""

MASS_KG = Range(5.0, 400.0, "kg")
"""Body masses."""

SEXES = ("female", "male")


@dataclass(frozen=True, slots=True)
class Part:
    """One segment, or both of a pair, in a body of unit mass and unit height.

    Attributes: mass; height, of its centre of mass above the joint below; gyration, radius of gyration about the
    mediolateral axis through its centre of mass.
    """

    mass: float
    height: float
    gyration: float


@dataclass(frozen=True, slots=True)
class Proportions:
    """A table, for a body of unit mass and unit height: parts of the legs and of the upper body, lengths of the legs
    and from hip to shoulder, height of the ankle above the floor."""

    source: str
    legs: tuple[Part, ...]
    upper: tuple[Part, ...]
    length: float
    trunk: float
    ankle: float = 0.039


def hanging(mass: float, top: float, length: float, centre: float, gyration: float) -> Part:
    """A segment that hangs from ``top``; ``centre`` (from its top) and ``gyration`` are fractions of its length."""
    return Part(mass, top - centre * length, gyration * length)


def _winter() -> Proportions:
    ankle, knee, hip, shoulder = 0.039, 0.285, 0.530, 0.818
    return Proportions(
        "Winter (2009), Table 4.1",
        legs=(
            hanging(2 * 0.100, hip - ankle, hip - knee, 0.433, 0.323),
            hanging(2 * 0.0465, knee - ankle, knee - ankle, 0.433, 0.302),
        ),
        # the table counts from the greater trochanter upwards
        upper=(Part(0.678, 0.626 * (shoulder - hip), 0.496 * (shoulder - hip)),),
        length=hip - ankle,
        trunk=shoulder - hip,
        ankle=ankle,
    )


@dataclass(frozen=True, slots=True)
class _DeLeva:
    """Rows of de Leva's Table 4: lengths in mm; per segment (mass, centre, gyration about the transverse axis)."""

    stature: float
    vertex_c7: float
    c7_hip: float
    shoulder_hip: float
    thigh_length: float
    knee_malleolus: float
    knee_ankle: float
    arm_lengths: tuple[float, float, float]
    head: tuple[float, float, float]
    trunk: tuple[float, float, float]
    arm: tuple[tuple[float, float, float], ...]
    thigh: tuple[float, float, float]
    shank: tuple[float, float, float]


_MAN = _DeLeva(
    stature=1741.0,
    vertex_c7=242.9,
    c7_hip=603.3,
    shoulder_hip=515.5,
    thigh_length=422.2,
    knee_malleolus=434.0,
    knee_ankle=440.3,
    arm_lengths=(281.7, 268.9, 86.2),
    head=(0.0694, 0.5002, 0.315),
    trunk=(0.4346, 0.5138, 0.306),
    arm=((0.0271, 0.5772, 0.269), (0.0162, 0.4574, 0.265), (0.0061, 0.7900, 0.513)),
    thigh=(0.1416, 0.4095, 0.329),
    shank=(0.0433, 0.4459, 0.249),
)

_WOMAN = _DeLeva(
    stature=1735.0,
    vertex_c7=243.7,
    c7_hip=614.8,
    shoulder_hip=497.9,
    thigh_length=368.5,
    knee_malleolus=432.3,
    knee_ankle=438.6,
    arm_lengths=(275.1, 264.3, 78.0),
    head=(0.0668, 0.4841, 0.295),
    trunk=(0.4257, 0.4964, 0.292),
    arm=((0.0255, 0.5754, 0.260), (0.0138, 0.4559, 0.257), (0.0056, 0.7474, 0.454)),
    thigh=(0.1478, 0.3612, 0.364),
    shank=(0.0481, 0.4416, 0.267),
)


def _deleva(rows: _DeLeva, sex: str) -> Proportions:
    def part(values: tuple[float, float, float], top: float, length: float, count: int = 1) -> Part:
        mass, centre, gyration = values
        return hanging(count * mass, top / rows.stature, length / rows.stature, centre, gyration)

    elbow = rows.shoulder_hip - rows.arm_lengths[0]
    tops = (rows.shoulder_hip, elbow, elbow - rows.arm_lengths[1])
    arms = (part(*given, count=2) for given in zip(rows.arm, tops, rows.arm_lengths, strict=True))
    length = rows.thigh_length + rows.knee_ankle
    return Proportions(
        f"de Leva (1996), Table 4, {sex}",
        legs=(
            part(rows.thigh, length, rows.thigh_length, count=2),
            part(rows.shank, rows.knee_ankle, rows.knee_malleolus, count=2),
        ),
        upper=(
            part(rows.head, rows.c7_hip + rows.vertex_c7, rows.vertex_c7),
            part(rows.trunk, rows.c7_hip, rows.c7_hip),
            *arms,
        ),
        length=length / rows.stature,
        trunk=rows.shoulder_hip / rows.stature,
    )


TABLES: Mapping[str, Mapping[str | None, Proportions]] = {
    "winter": {sex: _winter() for sex in (None, *SEXES)},
    "deleva": {"male": _deleva(_MAN, "male"), "female": _deleva(_WOMAN, "female")},
}
"""Tables by name and sex; None where the sex is not stated."""


def proportions(sex: str | None = None, table: str | None = None) -> Proportions:
    """The table for a person; without its name ``deleva`` where the sex is stated, else ``winter``.

    Raises `ModelError` for an unknown sex or table, and for ``deleva`` without a sex.
    """
    if sex is not None and sex not in SEXES:
        raise ModelError(f"body.sex: expected {' or '.join(SEXES)}, or none, got {sex!r}")
    name = table or ("winter" if sex is None else "deleva")
    if name not in TABLES:
        raise ModelError(f"body.table: expected {' or '.join(TABLES)}, got {name!r}")
    if sex not in TABLES[name]:
        raise ModelError(f"body.table: {name} has tables for {' and '.join(SEXES)}; expected body.sex")
    return TABLES[name][sex]


def segments(height: float, mass: float, sex: str | None = None, table: str | None = None) -> dict[str, float]:
    """The arguments of `mcstudy.Body.from_segments`: m1, h1, I1, m2, h2, I2, L1 (kg, m, kg m^2).

    Parameters
    ----------
    height, mass
        Of the whole body, m and kg.
    sex
        ``"female"`` or ``"male"``; None for a table without.
    table
        ``"winter"`` or ``"deleva"``; when None, ``deleva`` where the sex is stated, else ``winter``.

    Raises
    ------
    ModelError
        A value is out of range, or no such table.
    """
    for name, value, limits, hint in (("height", height, HEIGHT_M, "m"), ("weight", mass, MASS_KG, "kg")):
        if fault := limits.fault(value):
            raise ModelError(f"body.{name}: {fault}; is it in {hint}?")
    proportion = proportions(sex, table)
    m1, h1, r1 = _joined(proportion.legs)
    m2, h2, r2 = _joined(proportion.upper)
    return {
        "m1": m1 * mass,
        "h1": h1 * height,
        "I1": m1 * mass * (r1 * height) ** 2,
        "m2": m2 * mass,
        "h2": h2 * height,
        "I2": m2 * mass * (r2 * height) ** 2,
        "L1": proportion.length * height,
    }


def _joined(parts: tuple[Part, ...]) -> tuple[float, float, float]:
    """Mass, height of the centre of mass and radius of gyration of several parts (parallel axes)."""
    mass = sum(p.mass for p in parts)
    height = sum(p.mass * p.height for p in parts) / mass
    inertia = sum(p.mass * (p.gyration**2 + (p.height - height) ** 2) for p in parts)
    return mass, height, math.sqrt(inertia / mass)


def centre_of_mass(segments: Mapping[str, float], trunk: float) -> tuple[float, float]:
    """Weights of the positions of hip and shoulder, from the ankle, in that of the centre of mass of the body.

    The centre of each segment lies on the line between its ends, at the share of its length that the table says.

    Parameters
    ----------
    segments
        m1, h1, m2, h2, L1 as `segments` returns them.
    trunk
        Height of the shoulder above the hip by the same table, m.
    """
    legs, upper = segments["h1"] / segments["L1"], segments["h2"] / trunk
    total = segments["m1"] + segments["m2"]
    # legs: legs * x_hip; upper body: x_hip + upper * (x_shoulder - x_hip)
    of_shoulder = segments["m2"] * upper / total
    of_hip = (segments["m1"] * legs + segments["m2"]) / total - of_shoulder
    return of_hip, of_shoulder
