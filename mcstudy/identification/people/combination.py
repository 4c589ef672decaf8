"""From the fits of many people to their population, by condition, and the differences between conditions."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from mcstudy.errors import InputError
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.people.group_record import GroupDifference, GroupMean, GroupRecord, Individual
from mcstudy.identification.people.likelihood import difference, of_fit, possible
from mcstudy.identification.people.members import Member
from mcstudy.identification.people.population import Interval, Population
from mcstudy.identification.people.two_means import Difference, paired, unpaired
from mcstudy.stance.body import Body


def combine(
    fits: Sequence[Member[FitRecord]], *, pair: bool | None = None, failed: Sequence[tuple[str, str, str]] = ()
) -> GroupRecord:
    """The population of fitted people.

    Parameters
    ----------
    fits: one `FitRecord` per member. pair: as in `mcstudy.fit_group`. failed: (person, condition, reason) of recordings
    without a fit.

    Raises `InputError` when the fits do not belong together, or there are too few.
    """
    people = {(m.person, m.condition): m.items[0] for m in fits}
    conditions = tuple(dict.fromkeys(m.condition for m in fits))
    by_condition = {c: [p for p, condition in people if condition == c] for c in conditions}
    lost = "; ".join(f"{person}, {c}: {why}" for person, c, why in failed)
    for c, names in by_condition.items():
        if len(names) < 2:
            raise InputError(
                f"people: expected at least two in condition {c}, got one ({names[0]}): the variance between people "
                "cannot be estimated" + (f" ({lost})" if lost else "")
            )
    _alike(fits)
    is_paired = _paired(by_condition, pair)
    first = fits[0].items[0]
    likelihood = {key: of_fit(f) for key, f in people.items()}
    means, differences = [], []
    for e in first.estimates:
        limits = possible(first.model, e.name)
        populations = {
            c: Population([likelihood[p, c][e.name] for p in by_condition[c]], first.level, limits) for c in conditions
        }
        for c, population in populations.items():
            estimates = [people[p, c][e.name] for p in by_condition[c]]
            shrunken = population.individual() or [Interval(np.nan, np.nan, np.nan)] * len(estimates)
            individuals = tuple(
                Individual(p, x.estimate, x.low, x.high, x.low_from, x.high_from, *s[:3])
                for p, x, s in zip(by_condition[c], estimates, shrunken, strict=True)
            )
            spread = population.between()
            between = spread._replace(value=spread.value if spread.value > 0 else np.nan)
            means.append(GroupMean(e.name, e.unit, c, *population.mean(), *between, individuals))
        for reference, c in itertools.combinations(conditions, 2):
            both = by_condition[reference]
            if is_paired:
                changes = [difference(likelihood[p, c][e.name], likelihood[p, reference][e.name]) for p in both]
                test = paired(Population(changes, first.level))
            else:
                test = unpaired(populations[c], populations[reference])
            sizes = len(by_condition[c]), len(both)
            differences.append(_difference(e.name, e.unit, c, reference, is_paired, sizes, test))
    return GroupRecord(
        level=first.level,
        conditions=conditions,
        paired=is_paired,
        means=tuple(means),
        differences=tuple(differences),
        fits=dict(people),
        failed=tuple(failed),
        warnings=tuple(_warnings(fits)),
    )


def _difference(
    name: str, unit: str, c: str, reference: str, is_paired: bool, people: tuple[int, int], test: Difference
) -> GroupDifference:
    return GroupDifference(name, unit, c, reference, is_paired, people, *test.interval, test.p_value)


def _alike(fits: Sequence[Member[FitRecord]]) -> None:
    """Raise `InputError` unless all fits have one level and the same quantities, and each person one body."""
    first, bodies = fits[0], dict[str, Body]()
    for m in fits:
        fitted, like = m.items[0], first.items[0]
        if fitted.level != like.level:
            raise InputError(f"{m.name}: level: expected {like.level:g} as of {first.name}, got {fitted.level:g}")
        names, expected = ([e.name for e in f.estimates] for f in (fitted, like))
        if names != expected:
            raise InputError(
                f"{m.name}: quantities: expected {', '.join(expected)} as of {first.name}, got {', '.join(names)}"
            )
        if fitted.recording is not None:
            body = bodies.setdefault(m.person, fitted.recording.body)
            if body != fitted.recording.body:
                raise InputError(f"{m.name}: body: expected the same in all recordings of {m.person}")


def _paired(by_condition: dict[str, list[str]], wanted: bool | None) -> bool:
    """Whether every person is in every condition; raises `InputError` when ``wanted`` says otherwise, or some are."""
    if len(by_condition) == 1:
        if wanted:
            (only,) = by_condition
            raise InputError(f"paired: expected at least two conditions, got one ({only})")
        return False
    everyone = dict.fromkeys(p for names in by_condition.values() for p in names)
    count = {p: sum(p in names for names in by_condition.values()) for p in everyone}
    partial = [p for p, n in count.items() if n < len(by_condition)]
    if wanted is False:
        return False
    if not partial:
        return True
    if wanted or len(partial) < len(count) or max(count.values()) > 1:
        p = partial[0]
        present = ", ".join(c for c, names in by_condition.items() if p in names)
        raise InputError(
            f"paired: expected every person in all conditions ({', '.join(by_condition)}), {p} is only in {present}; "
            "leave this person out, or choose unpaired"
        )
    return False


def _warnings(fits: Sequence[Member[FitRecord]]) -> Iterator[str]:
    for m in fits:
        for text in m.items[0].warnings:
            yield f"{m.name}: {text}"
    poor = [m.name for m in fits if m.items[0].p_value < 0.05]
    if len(poor) > max(1, 0.2 * len(fits)):
        yield f"the model does not fit the recordings of {len(poor)} of {len(fits)} (p < 0.05): {'; '.join(poor)}"
    kinds = {getattr(m.items[0].recording, "stimulus", None) for m in fits}
    if len(kinds) > 1:
        yield f"stimuli of several kinds are combined: {', '.join(sorted(map(str, kinds)))}"
