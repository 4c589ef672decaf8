"""A fit of several conditions in words: what differs, what is shared, and whether that holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mcstudy.gap.questions.detection import LEVEL
from mcstudy.identification import tables, words
from mcstudy.identification.conditions.record import ConditionsRecord
from mcstudy.identification.conditions.sharing import Sharing
from mcstudy.identification.estimate import Estimate
from mcstudy.text_tables import LEAST_P, Table, fill, number, p_value, p_words, with_error

MOST_TOLD = 2
"""Parameters with a value in each condition whose values are told in a sentence."""


def text(r: ConditionsRecord, *, details: bool = False) -> str:
    """The answer, then one table; with ``details`` also all that is said of the fit of one recording."""
    heading = f"{' | '.join(r.conditions)}: one person, {len(r.fit.lines)} lines up to {r.fit.lines.f.max():.3g} Hz"
    first = "\n".join(fill(sentence) for sentence in (differing(r), holding(r), fitting(r)) if sentence)
    shown = [heading, first, estimates(r).text()]
    return "\n\n".join([*shown, *([words.text(r.fit)] if details else [])])


def differing(r: ConditionsRecord) -> str:
    """What the parameters with a value in each condition are, and whether they differ."""
    separate = [s for s in r.sharings if s.separate]
    if not separate:
        return "All conditions share all parameters."
    if len(separate) <= MOST_TOLD:
        return " ".join(_told(r, s) for s in separate)
    groups = {
        "Between conditions differ": [s for s in separate if s.p_value < LEVEL],
        "Not beyond chance differ": [s for s in separate if s.p_value >= LEVEL],
    }
    each = {k: ", ".join(f"{s.name} ({p_words(s.p_value)})" for s in found) for k, found in groups.items() if found}
    return " ".join(f"{k} {names}." for k, names in each.items())


def _told(r: ConditionsRecord, s: Sharing) -> str:
    verb = "differs" if s.p_value < LEVEL else "does not differ beyond chance"
    values = ", ".join(f"{c} {number(r[s.name, c].estimate)}" for c in s.conditions)
    return f"{s.name} {verb} between conditions ({p_words(s.p_value)}): {values} {unit_of(s)}".rstrip() + "."


def holding(r: ConditionsRecord) -> str:
    """Whether one value for all conditions holds of what is shared."""
    shared = [s for s in r.sharings if not s.separate]
    if not shared:
        return ""
    doubted = doubtful(shared)
    fine = [s.name for s in shared if s not in doubted]
    out = f"One value for all conditions is consistent with the recordings for {', '.join(fine)}." if fine else ""
    for s in doubted:
        seen = unseen_words(s)
        out += f" One value of {s.name} does not hold ({p_words(s.p_value)}{seen}): it changes by {percent(s)}."
    return out.strip()


def doubtful(shared: Sequence[Sharing]) -> list[Sharing]:
    """Shared parameters whose sharing is rejected, with all of them tested (Holm 1979)."""
    ordered = sorted(shared, key=lambda s: s.p_value)
    for k, s in enumerate(ordered):
        if s.p_value * (len(ordered) - k) >= LEVEL:
            return ordered[:k]
    return ordered


def unseen_words(s: Sharing) -> str:
    """What cycles that the fits did not see say of the sharing; empty where there are none."""
    if s.unseen is None or s.unseen_se is None:
        return ""
    clear = abs(s.unseen) > words.CLEAR * s.unseen_se
    return (
        f"; held-out cycles {'agree' if s.unseen > 0 else 'contradict'}" if clear else "; held-out cycles do not tell"
    )


def percent(s: Sharing) -> str:
    """Largest minus smallest value in percent of their mean."""
    mean = abs(sum(s.values) / len(s.values))
    return f"{number(100 * s.change / mean, 2)} %" if mean > 0 else "-"


def unit_of(known: Sharing | Estimate) -> str:
    """Its unit; nothing where it has none."""
    return "" if known.unit == "1" else known.unit


def fitting(r: ConditionsRecord) -> str:
    """Whether the model fits, and what bounds decide."""
    f = r.fit
    fits = (
        "consistent with noise"
        if f.p_value >= LEVEL
        else "larger than expected from noise, so the model lacks something"
    )
    out = f"The squared residual is {fits}: {f.chi2:.0f}, expected {f.expected_chi2:.0f} ({p_words(f.p_value)})."
    if f.growth_rate >= 0:
        out += f" The closed loop of a condition is unstable ({words.rightmost_root(f)})."
    open_ends = [e.name for e in f.estimates if e.verdict != "identifiable"]
    return out + (f" Bounds of the fit, not the recordings, limit {', '.join(open_ends)}." if open_ends else "")


def estimates(r: ConditionsRecord) -> Table:
    """Every parameter in every condition, and the tests of its sharing."""
    cycles = any(s.unseen is not None for s in r.sharings)
    held = ["held out"] * cycles
    header = ["parameter", "unit", "estimate", f"{100 * r.fit.level:g} % interval", "p", *held, "change"]
    rows = [row for name in r.shared_model.names for row in _rows(r, name, cycles)]
    note = (
        "p: chance of conditions so different where they share the parameter, the others as here. change: largest "
        "minus smallest value where each condition has one."
    )
    if cycles:
        note += " held out: squared residual of unseen cycles, shared minus separate (positive: they differ)."
    return Table("Estimates", header, rows, note)


def _rows(r: ConditionsRecord, name: str, cycles: bool) -> Iterator[list[str]]:
    """A row for the parameter, or one for each condition with a value of its own."""
    s = next((s for s in r.sharings if s.name == name), None)
    test = [""] * (2 + cycles)
    if s is not None:
        unseen = "-" if s.unseen is None else with_error(s.unseen, s.unseen_se)
        test = [p_value(s.p_value, LEAST_P), *[unseen] * cycles, percent(s)]
    for condition in s.conditions if s and s.separate else [""]:
        e = r[name, condition] if condition else r[name]
        label = f"{name}, {condition}" if condition else name
        yield [label, unit_of(e), number(e.estimate), tables.marked(r.fit, e), *test]
        test = [""] * len(test)
