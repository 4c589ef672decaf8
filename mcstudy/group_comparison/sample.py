"""Two groups as numbers: responses of the people of both, and relabellings of the groups that are equally likely.

If the groups do not differ at all, any exchange of labels is as likely as the one that was observed: within every
person when the same people are in both groups (paired), between people otherwise. Statistics of relabelled groups then
have the distribution of the statistic without a difference, exactly, whatever the distribution of people.

Groups may also differ in something that is not asked, as means may be equal where noise is not. Relabelled groups share
the noise of both, so their differences scatter by another amount than the observed one if the groups are of unequal
size. Each difference is therefore measured in units of its own error, that of Welch, with the variances of its own two
groups (`Relabelled.variance`): relabelling is then still exact if the groups do not differ at all, and right for many
people if only their means are equal (Janssen 1997, Stat Probab Lett 36:9; Chung & Romano 2013, Ann Stat 41:484).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.spectra.frf_groups import LEAST_PEOPLE, Scatter, as_complex, as_real, scatter

LEAST_VARIANCE = 1e-9
"""Of relabelled groups, relative to that of groups that do not differ."""


@dataclass(frozen=True)
class Sample:
    """Responses of two groups, in the numbers of `as_real`.

    Attributes
    ----------
    a, b: (people, D). paired: whether row i of both is the same person.
    """

    a: np.ndarray
    b: np.ndarray
    paired: bool

    @property
    def difference(self) -> np.ndarray:
        """Mean of b minus mean of a, (D,)."""
        return np.asarray(self.b.mean(axis=0) - self.a.mean(axis=0))

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean of both groups, with equal weight, as complex response (2, N)."""
        return as_complex((self.a.mean(axis=0) + self.b.mean(axis=0)) / 2)

    @cached_property
    def person(self) -> Scatter:
        """Covariance of one person about the mean of the own group."""
        return scatter(self.a, self.b)

    @cached_property
    def one(self) -> np.ndarray:
        """Covariance (D, D) of the difference times people: of one person's difference when paired.

        The groups share the form of their covariance and not its size, which their noise and their people set.
        """
        if self.paired:
            return scatter(self.b - self.a).covariance
        return self.person.covariance * self._per_person * self.people

    @property
    def _per_person(self) -> float:
        """Variance of the difference of different people in units of the common variance of a person."""
        variance = np.diag(self.person.covariance)
        of_a, of_b = (float(np.mean(x.var(axis=0, ddof=1) / variance)) for x in (self.a, self.b))
        return of_a / len(self.a) + of_b / len(self.b)

    @property
    def people(self) -> int:
        """Independent people."""
        return len(self.a) if self.paired else len(self.a) + len(self.b)

    @property
    def error(self) -> np.ndarray:
        """Covariance (D, D) of `difference`."""
        return np.asarray(self.one / self.people)

    @property
    def mean_error(self) -> np.ndarray:
        """Covariance (D, D) of `mean` as real numbers."""
        if self.paired:
            return scatter((self.a + self.b) / 2).covariance / len(self.a)
        return np.asarray(self.person.covariance * self._per_person / 4)

    def part(self, a: np.ndarray, b: np.ndarray) -> Sample:
        """Some people only: rows of a and of b."""
        return Sample(self.a[a], self.b[b], self.paired)

    @property
    def relabellings(self) -> int:
        """Number of different relabellings, the observed one among them."""
        return 2 ** len(self.a) if self.paired else comb(self.people, len(self.b))

    def least_p(self, labels: np.ndarray) -> float:
        """The smallest p-value of a two-sided test that memberships (n, rows) allow.

        In groups of equal size the exchange of all labels has the same size of the difference as the observed one.
        """
        mirrored = 1 + (len(self.a) == len(self.b) and len(labels) == self.relabellings)
        return mirrored / len(labels)

    def relabelled(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Membership in b of all rows of a and then b, (1 + n, rows) bool; the first is the observed one.

        All different ones, once each, if they are no more than 1 + n.
        """
        na, nb = len(self.a), len(self.b)
        observed = np.arange(na + nb) >= na
        if self.relabellings <= 1 + n:
            if self.paired:
                swapped = np.array(list(itertools.product((False, True), repeat=na)))
                return np.hstack([swapped, ~swapped])
            all_b = np.array(list(itertools.combinations(range(na + nb), nb)))[::-1]  # the last of all is the observed
            out = np.zeros((len(all_b), na + nb), dtype=bool)
            out[np.arange(len(all_b))[:, None], all_b] = True
            return out
        out = np.tile(observed, (1 + n, 1))
        if self.paired:
            swapped = rng.random((n, na)) < 0.5
            out[1:, :na], out[1:, na:] = swapped, ~swapped
        else:
            out[1:] = rng.permuted(out[1:], axis=1)
        return out

    def differences(self, labels: np.ndarray) -> Relabelled:
        """Differences of relabelled groups, for memberships (n, rows), with their own variances."""
        if self.paired:
            change = self.b - self.a
            sign = np.where(labels[:, len(self.a) :], 1.0, -1.0)
            n = len(change)
            mean = sign @ change / n
            variance = ((change**2).mean(axis=0) - mean**2) / (n - 1)
            return Relabelled(mean, np.maximum(variance, 0.0), (change**2).mean(axis=0) / n)
        both = np.concatenate([self.a, self.b])
        y = both - both.mean(axis=0)
        of_b = labels.astype(float)
        mean_a, variance_a = _mean_of(1 - of_b, y)
        mean_b, variance_b = _mean_of(of_b, y)
        scale = y.var(axis=0) * (1 / len(self.a) + 1 / len(self.b))
        return Relabelled(mean_b - mean_a, variance_a + variance_b, scale)


class Relabelled(NamedTuple):
    """Differences of n pairs of groups, b minus a.

    Attributes
    ----------
    difference: (n, D). variance: (n, D), of each, from the scatter in its own two groups.
    scale: (D,), the same for all relabellings: variance of a difference if the groups do not differ.
    """

    difference: np.ndarray
    variance: np.ndarray
    scale: np.ndarray

    def of(self, numbers: np.ndarray) -> np.ndarray:
        """Squared differences of some ``numbers`` (D,) bool in units of their variances, (n,).

        Numbers are weighed with `scale`, and only the mean of their variances is that of the relabelled groups: with
        few people, one variance of a single number is often too small by chance.
        """
        squares = (self.difference[:, numbers] ** 2 / self.scale[numbers]).sum(axis=1)
        variance = (self.variance[:, numbers] / self.scale[numbers]).sum(axis=1)
        return np.asarray(squares / np.maximum(variance, LEAST_VARIANCE * numbers.sum()))


def _mean_of(members: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, D) of groups with memberships (n, rows) of 0 and 1, and the variances of these means."""
    n = members.sum(axis=1, keepdims=True)
    mean = members @ y / n
    variance = (members @ y**2 / n - mean**2) / (n - 1)
    return mean, np.maximum(variance, 0.0)


def sample_of(a: xr.Dataset, b: xr.Dataset, paired: bool | None = None) -> Sample:
    """The people of two groups, each a dataset of one condition; those without a response are left out.

    ``paired``: whether people of the same name are compared with themselves; None: if the names are the same in both.
    Raises `InputError` for groups of other points or stimuli, and for too few people.
    """
    for name, group in (("a", a), ("b", b)):
        if group["frf"].sizes.get("condition", 1) != 1:
            conditions = "; ".join(map(str, group["condition"].values))
            raise InputError(f"{name}: expected one condition, got {conditions}; choose one with .sel(condition=...)")
    for field in ("average", "f_line"):
        if a[field].shape != b[field].shape or not np.allclose(a[field], b[field]):
            raise InputError("groups: expected the same points and harmonics in both")
    if a.attrs["stimulus"] != b.attrs["stimulus"]:
        raise InputError(f"groups: expected one stimulus, got {a.attrs['stimulus']} and {b.attrs['stimulus']}")
    rows = [_rows(group) for group in (a, b)]
    common = [person for person in rows[0] if person in rows[1]]
    if paired is None:
        paired = set(rows[0]) == set(rows[1])
        if common and not paired:
            raise InputError(
                f"groups: {len(common)} people are in both and others in one; expected paired = True (pairs those "
                "in both) or paired = False (treats all people as independent)"
            )
    if paired:
        x, y = (np.array([group[person] for person in common]) for group in rows)
    else:
        x, y = (np.array(list(group.values())) for group in rows)
    for name, values in (("a", x), ("b", y)):
        if len(values) < LEAST_PEOPLE:
            which = " that are in both groups" if paired else ""
            raise InputError(
                f"{name}: expected at least {LEAST_PEOPLE} people with all responses{which}, got {len(values)}"
            )
    return Sample(x, y, paired)


def _rows(group: xr.Dataset) -> dict[str, np.ndarray]:
    frf = group["frf"].squeeze("condition") if "condition" in group["frf"].dims else group["frf"]
    values = as_real(frf.transpose("person", "segment", "point").values)
    return {str(p): row for p, row in zip(group["person"].values, values, strict=True) if np.isfinite(row).all()}
