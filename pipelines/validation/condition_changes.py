"""What differs between two conditions of the same people: accounts compared by evidence and by prediction.

People are the only replicates of group FRFs, so every error here is an error over people:

* the mean of n people has the variance of one person divided by n. Fits of means are weighted with it. Correlations
  between points and conditions are left out of the weights: with them, a model that has a gap moves its misfit to where
  correlated errors make it cheap. They enter through the drawing of people;
* a single person is weighted with the variance between people. That is no measurement error: it says where people
  differ much, and a squared residual of 1 per number is that of a person predicted by the others' mean;
* evidence is prediction of people that were left out, and intervals come from drawing people with replacement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.problem import ml_cost
from mcstudy.fitting.solvers import fit as solve
from mcstudy.fitting.starts import uniform
from mcstudy.identification.bounds import DELAY_S
from mcstudy.recordings.frf_group import body_of_group
from mcstudy.spectra.frf_groups import as_complex, as_real, points_of, scatter
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from pipelines.validation.condition_fits import best_of, distinct, leaders, minima_of
from pipelines.validation.conditions import Change, Conditions, shifted, whitening_of

WIDEST = 5.0
"""Largest gain of a fit, relative to the value that is typical of the body."""

LEAST = 1e-6
"""Least gain, likewise: not zero, so that a factor can change it."""

LINEARISED, STARTS = 12, 2000
"""Linearised and random starts of the fit of one mean."""

ROUGH = 60
"""Distinct minima of the compiled solver that are fitted to the points exactly."""

LEADERS = 6
"""Distinct minima of a single mean from which fits of two conditions start."""

KEPT = 4
"""Distinct minima of an account, the lowest ones: where larger accounts and fits to other means of people start."""

TRIED = 0.25
"""Changes of a single factor's logarithm, or shifts of a weight, with both signs, from which an account starts too."""

AGAIN = 40
"""Iterations of fits that start from those to all people."""

PRIOR = 0.5
"""Spread of one person's parameters around those of the mean, relative to their size."""

NOTHING = Change("nothing")


def model_of_group(group: xr.Dataset, body: Body | None = None) -> Model:
    """The model of the group's stimulus on its body, with the bounds of `mcstudy.fit`; gains follow the weight."""
    body = body or body_of_group(group)
    model, ratio = two_segment(body, group.attrs["stimulus"]), body.mgh / Body().mgh
    fixed = (*model.delays, *model.weights)
    values = {p.name: p.value * (1.0 if p.name in fixed else ratio) for p in model.parameters}
    bounds = {n: (LEAST * v, WIDEST * v) for n, v in values.items() if n not in fixed}
    return model.with_bounds(bounds | dict.fromkeys(model.delays, DELAY_S)).with_values(values)


def problem_of(model: Model, group: xr.Dataset, change: Change, data: np.ndarray, covariance: np.ndarray) -> Conditions:
    """Fits of ``data`` (B, C, D) without a prior; ``covariance`` (C D, C D)."""
    free = np.full(len(model.names), np.inf)
    return Conditions(model, group, change, data, whitening_of(covariance), model.truth, free, model.lower, model.upper)


def minima(model: Model, group: xr.Dataset, mean: np.ndarray, covariance: np.ndarray, seed: int = 0) -> np.ndarray:
    """Distinct minima of the fit of one mean (D,), lowest first and stable ones before others, (up to `LEADERS`, P).

    The points, read as responses at their mean frequencies, are fitted by the compiled solver from linearised and
    random starts; its lowest minima are then fitted to the points as the averages that they are.
    """
    rng, f = np.random.default_rng(seed), group["f"].values
    points, (low, high) = as_complex(mean), np.diag(covariance).reshape(2, 2, -1).sum(axis=0)
    joints = np.column_stack([points[0], points[1] - points[0]])
    errors = np.moveaxis(np.array([[low, -low], [-low, low + high]]), -1, 0)
    rough = ml_cost(model, f, joints, errors)
    starts = np.concatenate([linearised(rough, rng, LINEARISED), uniform(model, rng, STARTS)])
    first = solve(rough, starts)
    near = first.estimate[distinct(first.cost, ROUGH)]
    exact = minima_of(problem_of(model, group, NOTHING, mean[None, None], covariance), near, np.zeros(len(near), int))
    return exact.unknowns[distinct(exact.cost, LEADERS)]


def pooled_minima(model: Model, group: xr.Dataset, conditions: Sequence[int]) -> np.ndarray:
    """`minima` of the means of several conditions, (M, P): starts of every fit of the group."""
    out = []
    for c in conditions:
        data = as_real(group["frf"].values[:, c])
        data = data[np.isfinite(data).all(axis=1)]
        out.append(minima(model, group, data.mean(axis=0), np.diag(data.var(axis=0, ddof=1)) / len(data)))
    return np.concatenate(out)


@dataclass(frozen=True)
class Account:
    """An account of what differs, fitted to the means of two conditions.

    Attributes
    ----------
    change: what may differ. unknowns: (Q,). sizes: (K,) factors, or shifts of weights. misfit: squared
        residual in standard errors of the mean. minima: (up to `KEPT`, Q), the lowest distinct ones, ``unknowns``
        first.
    """

    change: Change
    unknowns: np.ndarray
    sizes: np.ndarray
    misfit: float
    minima: np.ndarray


class Pair:
    """Two conditions of the same people, and the accounts of their difference.

    Parameters
    ----------
    model: the model. group: the group. first, second: positions of the conditions; the people who were recorded in both
        are used. starts: (M, P), of the fits besides minima of the mean of both conditions; `pooled_minima` of both
        conditions by default.
    """

    def __init__(
        self, model: Model, group: xr.Dataset, first: int, second: int, starts: np.ndarray | None = None
    ) -> None:
        self.model, self.group = model, group
        every = as_real(group["frf"].values[:, [first, second]])
        self.data = every[np.isfinite(every).all(axis=(1, 2))]
        n = len(self.data)
        self.one = np.diag(np.diag(scatter(self.data.reshape(n, -1)).covariance))  # variances alone, see above
        self.mean = self.data.mean(axis=0)
        alone = pooled_minima(model, group, (first, second)) if starts is None else starts
        variance = np.diag(self.one).reshape(2, -1) / n
        both = 1 / (1 / variance).sum(axis=0)  # the best body without a change is that of the weighted mean
        self._starts = np.concatenate(
            [minima(model, group, both * (self.mean / variance).sum(axis=0), np.diag(both)), alone]
        )

    def problem(self, change: Change, data: np.ndarray, people: int) -> Conditions:
        """The fit of means (B, 2, D) of ``people`` people each."""
        return problem_of(self.model, self.group, change, data, self.one / people)

    def accounts(self, wanted: Sequence[Change]) -> list[Account]:
        """Changes fitted to the means of all people.

        A change also starts from the minima of those among ``wanted`` that it contains, and is never worse than them.
        """
        found: dict[str, Account] = {}
        for change in sorted(wanted, key=lambda c: len(c.factors)):
            inner = [self._turned(a, change) for a in found.values()]
            found[change.name] = self._account(change, np.concatenate([self._begin(change), *inner]))
        return [found[change.name] for change in wanted]

    def _account(self, change: Change, starts: np.ndarray) -> Account:
        problem = self.problem(change, self.mean[None], len(self.data))
        q = leaders(problem, starts, KEPT)
        return Account(change, q[0], change.sizes(self.model, q[0]), float(problem.misfit(q[:1])[0]), q)

    def _begin(self, change: Change) -> np.ndarray:
        """Starts (S, Q) of an account: minima of single means without a change, and with one."""
        K, P = len(change.factors), len(self.model.names)
        starts = [np.hstack([self._starts, np.zeros((len(self._starts), K))])]
        if K == P:
            starts.append(self._apart())
        for k in range(K if K < P else 0):
            for size in (-TRIED, TRIED):
                starts.append(starts[0][:LEADERS] + size * np.eye(P + K)[P + k])
        return np.concatenate(starts)

    def _apart(self) -> np.ndarray:
        """Starts of the account in which every parameter differs: bodies that fit one condition, and the other."""
        model, variance = self.model, np.diag(self.one).reshape(2, -1)
        says = as_real(points_of(self.group, frf(model, self._starts, self.group["f_line"].values)))
        misfit = ((says[:, None] - self.mean) ** 2 / variance).sum(axis=2)  # (starts, conditions)
        near, far = (self._starts[np.argsort(own)[:KEPT]] for own in misfit.T)
        near, far = np.repeat(near, len(far), axis=0), np.tile(far, (len(near), 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(shifted(model), far - near, np.log(far / near))
        return np.hstack([near, step])

    def _turned(self, smaller: Account, change: Change) -> np.ndarray:
        """The minima of a smaller account as starts (S, Q) of one that contains it; none of any other."""
        P = len(self.model.names)
        turn = smaller.change.within(change, self.model)
        if turn is None:
            return np.zeros((0, P + len(change.factors)))
        return np.hstack([smaller.minima[:, :P], smaller.minima[:, P:] @ turn.T])

    def refitted(
        self, accounts: Sequence[Account], means: np.ndarray, people: int, most: int = KEPT
    ) -> list[np.ndarray]:
        """Unknowns (B, Q) of every account, fitted again to means (B, 2, D) of ``people`` people each.

        The fits start from the ``most`` lowest minima for all people.
        """
        return [best_of(self.problem(a.change, means, people), a.minima[:most, None], AGAIN).unknowns for a in accounts]

    def halves(self, accounts: Sequence[Account], splits: int, seed: int = 0) -> np.ndarray:
        """Cross-validated misfit of accounts, (accounts, 2 ``splits``): 1 is the scatter between random halves.

        An account is fitted to the means of one half of the people and compared with those of the other half. The
        mean squared difference is in units of the variance of the difference of two such means, so that an account
        that is true scores 1 but for the error of its fit, which counts against unneeded parameters.
        """
        first, second = split_means(self.data, splits, seed)
        n = len(self.data) / 2
        unit = 2 * np.diag(self.one) / n
        unknowns = self.refitted(accounts, first, int(n))
        scores = []
        for a, q in zip(accounts, unknowns, strict=True):
            far = (self.problem(a.change, first, int(n)).predicted(q) - second).reshape(len(q), -1)
            scores.append((far**2 / unit).mean(axis=1))
        return np.array(scores)

    def resampled(self, accounts: Sequence[Account], draws: int, seed: int = 0) -> list[np.ndarray]:
        """Sizes (draws, K) of every account, from people drawn with replacement."""
        rng, n = np.random.default_rng(seed), len(self.data)
        means = np.stack([self.data[rng.integers(n, size=n)].mean(axis=0) for _ in range(draws)])
        refitted = self.refitted(accounts, means, n)
        return [a.change.sizes(self.model, q) for a, q in zip(accounts, refitted, strict=True)]

    def held_out(self, accounts: Sequence[Account], *, reverse: bool = False) -> dict[str, np.ndarray]:
        """Misfit (people,) of every person's second condition, predicted from the first (or ``reverse``).

        An account is fitted to the means of the other people. A person's parameters come from one condition of that
        person alone, with a weak prior around those of the account; the change of the account is applied to them.
        Three predictions without a model are beside the accounts: the person's own response unchanged, times the ratio
        of the others' means, and the others' mean. The unit is the variance between people: the others' mean scores
        1 + 1/n.
        """
        n = len(self.data)
        known, wanted = (1, 0) if reverse else (0, 1)
        D, P = self.mean.shape[1], len(self.model.names)
        one = self.one[known * D : known * D + D, known * D : known * D + D]
        others = (n * self.mean - self.data) / (n - 1)
        unit = np.diag(self.one)[wanted * D : wanted * D + D]
        alone = problem_of(self.model, self.group, NOTHING, self.data[:, known : known + 1], one)

        def score(predicted: np.ndarray) -> np.ndarray:
            return np.asarray(((predicted - self.data[:, wanted]) ** 2 / unit).mean(axis=1))

        out = {}
        for a, q in zip(accounts, self.refitted(accounts, others, n - 1, 1), strict=True):
            to_known, to_wanted = (a.change.applied, a.change.undone) if reverse else (None, a.change.applied)
            centre = to_known(self.model, q[:, :P], q) if to_known else q[:, :P]
            spread = PRIOR * (np.abs(centre.mean(axis=0)) + self.model.truth)
            theta = best_of(replace(alone, centre=centre, spread=spread), centre[None], AGAIN).unknowns
            lines = frf(self.model, to_wanted(self.model, theta, q), self.group["f_line"].values)
            out[a.change.name] = score(as_real(points_of(self.group, lines)))
        ratio = as_complex(others[:, wanted]) / as_complex(others[:, known])
        out["own response, unchanged"] = score(self.data[:, known])
        out["own response, times the others' ratio"] = score(as_real(as_complex(self.data[:, known]) * ratio))
        out["mean of the others"] = score(others[:, wanted])
        return out


def split_means(data: np.ndarray, splits: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of random halves of people (n, ...), (2 splits, ...) each: both ways round."""
    rng, n = np.random.default_rng(seed), len(data)
    pairs = []
    for _ in range(splits):
        order = rng.permutation(n)
        a, b = data[order[: n // 2]].mean(axis=0), data[order[n // 2 :]].mean(axis=0)
        pairs += [(a, b), (b, a)]
    first, second = zip(*pairs, strict=True)
    return np.stack(first), np.stack(second)
