"""The outcome of a fit of many people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import named, plain
from mcstudy.identification.estimate import determined
from mcstudy.identification.fit_record import FitRecord
from mcstudy.text_tables import number

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Individual:
    """One person's value of a quantity.

    Attributes
    ----------
    person
        Name.
    estimate, low, high, low_from, high_from
        The person's own fit, as in `Estimate`.
    shrunken, shrunken_low, shrunken_high
        The value given the other people too, with its interval; nan for fewer than three people.
    """

    person: str
    estimate: float
    low: float
    high: float
    low_from: str
    high_from: str
    shrunken: float
    shrunken_low: float
    shrunken_high: float


@dataclass(frozen=True)
class GroupMean:
    """One quantity of all people in one condition.

    Attributes
    ----------
    quantity, unit, condition
        What, in which unit, in which condition.
    mean, low, high
        Mean of the population with its interval.
    low_from, high_from
        What ends the interval: "data", "bound" where most people have no own limit on that side, or "flat" where flat
        parts of their likelihoods make up half of the interval.
    between, between_low, between_high, between_low_from, between_high_from
        Standard deviation between people with its interval; the errors of the fits are not in it. Without a value (nan)
        where these explain all scatter: it may then be zero, and ``between_high`` is what it is at most.
    individuals
        Every person (`Individual`).
    """

    quantity: str
    unit: str
    condition: str
    mean: float
    low: float
    high: float
    low_from: str
    high_from: str
    between: float
    between_low: float
    between_high: float
    between_low_from: str
    between_high_from: str
    individuals: tuple[Individual, ...]

    @property
    def people(self) -> int:
        """Number of people."""
        return len(self.individuals)

    @property
    def verdict(self) -> str:
        """One of "determined", "lower limit only", "upper limit only" or "not determined"."""
        return determined(self.low_from, self.high_from, "determined")

    def __repr__(self) -> str:
        return f"{self.quantity}, {self.condition} = {with_interval(self.mean, self)}"


@dataclass(frozen=True)
class GroupDifference:
    """Difference of the means of one quantity between two conditions.

    Attributes
    ----------
    quantity, unit
        What, in which unit.
    condition, reference
        The difference is the mean in ``condition`` minus that in ``reference``.
    paired
        Whether the same people are compared with themselves.
    people
        Their numbers in condition and reference.
    difference, low, high, low_from, high_from
        Value, interval and what ends it, as in `GroupMean`.
    p_value
        Of no difference: 1 minus the level of the interval that ends at zero, whatever ends it. So it is below 0.05 if,
        and only if, the 95 % interval does not hold zero.
    """

    quantity: str
    unit: str
    condition: str
    reference: str
    paired: bool
    people: tuple[int, int]
    difference: float
    low: float
    high: float
    low_from: str
    high_from: str
    p_value: float

    @property
    def verdict(self) -> str:
        """As in `GroupMean`."""
        return determined(self.low_from, self.high_from, "determined")

    def __repr__(self) -> str:
        return f"{self.quantity}, {self.condition} - {self.reference} = {with_interval(self.difference, self)}"


@dataclass(frozen=True, repr=False)
class GroupRecord:
    """Parameters of many people.

    Attributes
    ----------
    level
        Level of the intervals.
    conditions
        Names of the conditions; the first is the reference of a difference.
    paired
        Whether differences are within people.
    means
        `GroupMean` of every quantity and condition, also by name: ``result["K11", "eyes open"]``, or
        ``result["K11"]`` for a single condition.
    differences
        `GroupDifference` of every quantity and pair of conditions.
    fits
        The fit of every (person, condition).
    failed
        (person, condition, reason) of everybody who could not be fitted.
    warnings
        Warnings of the fits, each with the name of the person.
    """

    level: float
    conditions: tuple[str, ...]
    paired: bool
    means: tuple[GroupMean, ...]
    differences: tuple[GroupDifference, ...]
    fits: Mapping[tuple[str, str], FitRecord]
    failed: tuple[tuple[str, str, str], ...]
    warnings: tuple[str, ...]

    def __getitem__(self, key: str | tuple[str, str]) -> GroupMean:
        quantity, condition = key if isinstance(key, tuple) else (key, None)
        if condition is None and len(self.conditions) == 1:
            (condition,) = self.conditions
        for m in self.means:
            if (m.quantity, m.condition) == (quantity, condition):
                return m
        raise KeyError(
            f"{key!r}; expected a quantity ({', '.join(self.quantities)}) with a condition "
            f"({', '.join(self.conditions)})"
        )

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities."""
        return tuple(dict.fromkeys(m.quantity for m in self.means))

    @property
    def people(self) -> tuple[str, ...]:
        """Names of all people with a fit."""
        return tuple(dict.fromkeys(person for person, _ in self.fits))

    def difference(self, quantity: str, condition: str | None = None, reference: str | None = None) -> GroupDifference:
        """The difference of a quantity; the conditions may be left out when there are two."""
        for d in self.differences:
            if d.quantity == quantity and condition in (None, d.condition) and reference in (None, d.reference):
                return d
        raise KeyError(f"{quantity!r} between {condition} and {reference}; conditions: {', '.join(self.conditions)}")

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data, valid under ``results_schema/1.0.0/group.json``."""
        return plain(
            {
                "schema": schema.identifier("group"),
                **named(self, "level", "conditions", "paired"),
                "means": [{**named(m), "verdict": m.verdict} for m in self.means],
                "differences": [{**named(d), "verdict": d.verdict} for d in self.differences],
                "fits": [
                    {"person": p, "condition": c, "name": f.name, "p_value": f.p_value, "lines": len(f.lines)}
                    for (p, c), f in self.fits.items()
                ],
                "failed": [dict(zip(("person", "condition", "reason"), row, strict=True)) for row in self.failed],
                "warnings": self.warnings,
            }
        )

    def to_xarray(self) -> xr.Dataset:
        """Means by (condition, quantity), differences by (comparison, quantity), people as (.., person), nan if absent.

        The dimension ``comparison`` is "second - first".
        """
        import xarray as xr

        shape = len(self.conditions), len(self.quantities)
        scalars = [f.name for f in fields(GroupMean) if f.name not in ("quantity", "unit", "condition", "individuals")]
        data: dict[str, Any] = {
            name: (
                ("condition", "quantity"),
                _table([self[q, c] for c in self.conditions for q in self.quantities], name, shape),
            )
            for name in scalars
        }
        for name in ("estimate", "low", "high", "shrunken", "shrunken_low", "shrunken_high"):
            values = np.full((*shape, len(self.people)), np.nan)
            for i, c in enumerate(self.conditions):
                for j, q in enumerate(self.quantities):
                    for individual in self[q, c].individuals:
                        values[i, j, self.people.index(individual.person)] = getattr(individual, name)
            data[f"individual_{name}"] = (("condition", "quantity", "person"), values)
        coords: dict[str, Any] = {
            "condition": list(self.conditions),
            "quantity": list(self.quantities),
            "person": list(self.people),
            "unit": ("quantity", [self[q, self.conditions[0]].unit for q in self.quantities]),
        }
        if self.differences:
            pairs = list(dict.fromkeys((d.condition, d.reference) for d in self.differences))
            coords["comparison"] = [f"{c} - {r}" for c, r in pairs]
            rows = [self.difference(q, *pair) for pair in pairs for q in self.quantities]
            for name in ("difference", "low", "high", "low_from", "high_from", "p_value"):
                key = name if name in ("difference", "p_value") else f"difference_{name}"
                data[key] = (("comparison", "quantity"), _table(rows, name, (len(pairs), shape[1])))
        return xr.Dataset(data, coords, {"level": self.level, "paired": int(self.paired)})


def with_interval(value: float, ends: GroupMean | GroupDifference) -> str:
    """``815 [586, 1309] N m/rad``, with the ends that bounds set in words."""
    low, high = (
        number(end) if ended == "data" else f"{ended} {number(end)}"
        for end, ended in ((ends.low, ends.low_from), (ends.high, ends.high_from))
    )
    return f"{number(value)} [{low}, {high}] {ends.unit}".rstrip()


def _table(records: Sequence[Any], name: str, shape: tuple[int, ...]) -> np.ndarray:
    return np.array([getattr(r, name) for r in records]).reshape(shape)
