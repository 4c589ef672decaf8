"""Two groups as numbers: responses of the people of both, and relabellings of the groups that are equally likely.

If the groups do not differ, any exchange of labels is as likely as the one that was observed: within every person when
the same people are in both groups (paired), between people otherwise. Statistics of relabelled groups therefore have
the distribution of the statistic without a difference, exactly, whatever the distribution of people.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.spectra.frf_groups import LEAST_PEOPLE, Scatter, as_complex, as_real, scatter


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
        """Covariance (D, D) of the difference times people: of one person's difference when paired."""
        if self.paired:
            return scatter(self.b - self.a).covariance
        return self.person.covariance * (1 / len(self.a) + 1 / len(self.b)) * self.people

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
        return np.asarray(self.person.covariance * (1 / len(self.a) + 1 / len(self.b)) / 4)

    def part(self, a: np.ndarray, b: np.ndarray) -> Sample:
        """Some people only: rows of a and of b."""
        return Sample(self.a[a], self.b[b], self.paired)

    def relabelled(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Membership in b of all rows of a and then b, (1 + n, rows) bool; the first is the observed one."""
        na, nb = len(self.a), len(self.b)
        out = np.zeros((1 + n, na + nb), dtype=bool)
        out[:, na:] = True
        if self.paired:
            swapped = rng.random((n, na)) < 0.5
            out[1:, :na], out[1:, na:] = swapped, ~swapped
        else:
            out[1:] = rng.permuted(out[1:], axis=1)
        return out

    def statistics(self, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Differences (n, D), and logarithms (n,) of the scatter of b over that of a, for memberships (n, rows).

        Scatter is the mean squared deviation from the mean of the group, each number in units of its SD.
        """
        both = np.concatenate([self.a, self.b])
        scale = np.sqrt(np.diag(self.person.covariance))
        y = (both - both.mean(axis=0)) / scale
        of_b, squares = labels.astype(float), (y * y).sum(axis=1)
        n_b = of_b.sum(axis=1)
        n_a = len(y) - n_b
        sum_b = of_b @ y
        mean_b, mean_a = sum_b / n_b[:, None], (y.sum(axis=0) - sum_b) / n_a[:, None]
        square_b = of_b @ squares
        within_b = (square_b - n_b * (mean_b**2).sum(axis=1)) / (n_b - 1)
        within_a = (squares.sum() - square_b - n_a * (mean_a**2).sum(axis=1)) / (n_a - 1)
        return (mean_b - mean_a) * scale, np.log(within_b / within_a)


def sample_of(a: xr.Dataset, b: xr.Dataset, paired: bool | None = None) -> Sample:
    """The people of two groups, each a dataset of one condition; those without a response are left out.

    ``paired``: whether people of the same name are compared with themselves; None: if the names are the same in both.
    Raises `InputError` for groups of other points or stimuli, and for too few people.
    """
    for name, group in (("a", a), ("b", b)):
        if group["frf"].sizes.get("condition", 1) != 1:
            found = "; ".join(map(str, group["condition"].values))
            raise InputError(f"{name}: expected one condition, got {found}; choose one with .sel(condition=...)")
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
                f"groups: {len(common)} people are in both and others in one; expected paired = True (compares those "
                "in both with themselves) or paired = False (takes all for different people)"
            )
    if paired:
        x, y = (np.array([own[person] for person in common]) for own in rows)
    else:
        x, y = (np.array(list(own.values())) for own in rows)
    for name, values in (("a", x), ("b", y)):
        if len(values) < LEAST_PEOPLE:
            of = " that are in both groups" if paired else ""
            raise InputError(
                f"{name}: expected at least {LEAST_PEOPLE} people with all responses{of}, got {len(values)}"
            )
    return Sample(x, y, paired)


def _rows(group: xr.Dataset) -> dict[str, np.ndarray]:
    frf = group["frf"].squeeze("condition") if "condition" in group["frf"].dims else group["frf"]
    values = as_real(frf.transpose("person", "segment", "point").values)
    return {str(p): row for p, row in zip(group["person"].values, values, strict=True) if np.isfinite(row).all()}
