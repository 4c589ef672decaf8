"""One body under several stimuli: the responses of all of them as those of one model.

The loop is the same whatever moves the body, so a set of recordings with different stimuli has one A(s; theta) and
several b_k(s; theta). A joint model holds the terms of the loop once and the stimulus terms of every kind. Its *blocks*
say which lines belong to which stimulus, so closed form, derivatives and the compiled fits give the responses of all
recordings at once. What changes a model (an effect) changes each of its `members` and joins them again; no effect needs
to know about joint models. Where parameters differ between the recordings (`split`), the terms that hold them are there
once for each block.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from mcstudy.errors import ModelError
from mcstudy.stance.body import STIMULI, WEIGHTS, Body, stimulus_terms
from mcstudy.stance.feedback import (
    Block,
    Derived,
    Filter,
    Model,
    Monomial,
    Output,
    OutputTerm,
    Parameter,
    Term,
    any_unit,
)

T = TypeVar("T", Term, OutputTerm)


def joined(models: Sequence[Model], lines: Sequence[int | None]) -> Model:
    """The joint model of ``models`` that differ in their stimulus only, with so many ``lines`` of each.

    Parameters of all models come first in the order of the first one, those of single models (sensory weights) after
    them. Raises `ModelError` when the models are not of one body.
    """
    first = models[0]
    loop = _loop(first)
    parameters: dict[str, Parameter] = {}
    filters: dict[str, Filter] = {}
    for m in models:
        if _loop(m) != loop or m.output_filters != first.output_filters or _measured(m) != _measured(first):
            raise ModelError(f"model {m.name}: expected the same body and feedback under every stimulus")
        for known, mine in ((parameters, m.parameters), (filters, m.filters)):
            for x in mine:
                if known.setdefault(x.name, x) != x:  # type: ignore[arg-type]
                    raise ModelError(f"model {m.name}: expected the same {x.name} under every stimulus")
    stimuli = [replace(t, stimulus=k) for k, m in enumerate(models) for t in m.terms if t.sense == "stimulus"]
    return replace(
        first,
        parameters=tuple(parameters.values()),
        terms=(*loop, *stimuli),
        filters=tuple(filters.values()),
        outputs=_outputs(models),
        blocks=tuple(Block(m.stimulus_unit, n) for m, n in zip(models, lines, strict=True)),
        derived=tuple({d.name: d for m in models for d in m.derived}.values()),
    )


def members(model: Model) -> tuple[Model, ...]:
    """The models of the single stimuli, each with all parameters; the model itself if it has one stimulus."""
    if not model.blocks:
        return (model,)
    return tuple(replace(under_some(model, [k]), blocks=()) for k in range(len(model.blocks)))


def under_some(model: Model, stimuli: Sequence[int]) -> Model:
    """The model under some of its several ``stimuli``, by position, in that order."""
    at = {stimulus: k for k, stimulus in enumerate(stimuli)}

    def heard(terms: Sequence[T]) -> tuple[T, ...]:
        return tuple(
            replace(t, stimulus=at.get(t.stimulus, 0)) for t in terms if t.sense != "stimulus" or t.stimulus in at
        )

    def there(t: Term) -> Term:
        return t if t.only is None else replace(t, only=at[t.only] if len(stimuli) > 1 else None)

    blocks = tuple(model.blocks[k] for k in stimuli)
    return replace(
        model,
        terms=tuple(there(t) for t in heard(model.terms) if t.only is None or t.only in at),
        outputs=tuple(replace(o, terms=heard(o.terms)) for o in model.outputs),
        stimulus_unit=any_unit(b.unit for b in blocks),
        blocks=blocks,
    )


def copies(model: Model, names: Collection[str]) -> dict[str, dict[int, str]]:
    """What each of some parameters of a joint model is called in each block that holds it, when they are `split`.

    Left out is a parameter that one block alone holds: it keeps its name. Raises `ModelError` for an unknown name, and
    for a parameter of a sensor's filter, which all recordings share.
    """
    model.check_names(names)
    sensors = _parameters(model, (f for f in model.output_filters if f is not None))
    if fixed := sensors.intersection(names):
        raise ModelError(f"{', '.join(sorted(fixed))}: expected a parameter of the loop, got that of a sensor's filter")
    labels = [re.sub(r"\W+", "_", label).strip("_") for label in model.stimulus_names]
    if len(set(labels)) < len(labels):
        raise ModelError(f"conditions: expected names that differ in their letters and digits, got {labels}")
    held = [
        _held(model, [t for t in model.terms if t.sense != "stimulus" or t.stimulus == k]) for k in range(len(labels))
    ]
    places = {name: [k for k, here in enumerate(held) if name in here] for name in model.names if name in names}
    return {name: {k: f"{name}_{labels[k]}" for k in at} for name, at in places.items() if len(at) > 1}


def split(model: Model, names: Collection[str]) -> Model:
    """A joint model in which some parameters have a value in each block, ``Kp_small`` and ``Kp_large`` for ``Kp``.

    Parameters in place of the shared one, in the order of the blocks, with its value and bounds. Derived quantities of
    such parameters are there for each block, too. Raises what `copies` raises.
    """
    known = copies(model, names)
    if not known:
        return model
    here = [{name: at[k] for name, at in known.items() if k in at} for k in range(len(model.blocks))]
    renamed = [_renamed_filters(model, mine, block.name) for mine, block in zip(here, model.blocks, strict=True)]
    terms: list[Term] = []
    for t in model.terms:
        if t.sense == "stimulus":
            terms.append(_renamed(t, here[t.stimulus], renamed[t.stimulus]))
            continue
        each = [_renamed(t, mine, filters) for mine, filters in zip(here, renamed, strict=True)]
        terms += [t] if all(x == t for x in each) else [replace(x, only=k) for k, x in enumerate(each)]
    parameters = [
        replace(p, name=name)
        for p in model.parameters
        for name in (known[p.name].values() if p.name in known else [p.name])
    ]
    derived = [d for mine, b in zip(here, model.blocks, strict=True) for d in _renamed_derived(model, mine, b.name)]
    return replace(
        model,
        parameters=tuple(parameters),
        terms=tuple(terms),
        filters=(
            *(f for f in model.filters if not _parameters(model, [f.name]) & set(known)),
            *(f for mine in renamed for f in mine.values()),
        ),
        derived=tuple(dict.fromkeys(derived)),
    )


def _parameters(model: Model, filters: Iterable[str]) -> set[str]:
    """Parameters in some of the filters."""
    wanted = set(filters)
    used = (m for f in model.filters if f.name in wanted for m in (*f.numerator, *f.denominator))
    return {name for m in used for name, _ in m.powers}


def _held(model: Model, terms: Sequence[Term]) -> set[str]:
    """Parameters in some of the terms."""
    own = {name for t in terms for name in (*t.gain, *t.all_delays)}
    return own | _parameters(model, (f for t in terms for f in t.filters))


def _renamed_filters(model: Model, names: Mapping[str, str], label: str) -> dict[str, Filter]:
    """The filters that hold renamed parameters, by the name that each had."""

    def piece(m: Monomial) -> Monomial:
        return replace(m, powers=tuple((names.get(name, name), power) for name, power in m.powers))

    return {
        f.name: Filter(f"{f.name}, {label}", tuple(map(piece, f.numerator)), tuple(map(piece, f.denominator)))
        for f in model.filters
        if _parameters(model, [f.name]) & set(names)
    }


def _renamed(t: Term, names: Mapping[str, str], filters: Mapping[str, Filter]) -> Term:
    return replace(
        t,
        gain=tuple(names.get(g, g) for g in t.gain),
        delay=names.get(t.delay or "", t.delay),
        late=names.get(t.late or "", t.late),
        filters=tuple(filters[f].name if f in filters else f for f in t.filters),
    )


def _renamed_derived(model: Model, names: Mapping[str, str], label: str) -> list[Derived]:
    """The derived quantities in one block."""
    found = []
    for d in model.derived:
        value = re.sub(r"\w+", lambda word: names.get(word[0], word[0]), d.value)
        name = value if d.name == d.value else f"{d.name}, {label}"
        found.append(d if value == d.value else replace(d, value=value, name=name))
    return found


def changed(model: Model, change: Callable[[Model], Model]) -> Model:
    """``change`` of a model, made to every member of a joint one."""
    if not model.blocks:
        return change(model)
    return replace(joined([change(m) for m in members(model)], [b.lines for b in model.blocks]), blocks=model.blocks)


def under(model: Model, kind: str, body: Body) -> Model:
    """The same loop moved by another ``kind`` of stimulus, on the ``body`` that ``model`` was built on.

    A tilt adds its sensory weight to the parameters, at its nominal value, unless it is there.
    """
    first_member = members(model)[0]
    loop = _loop(first_member)
    weight = [WEIGHTS[kind]] if kind in WEIGHTS and WEIGHTS[kind].name not in first_member.names else []
    return replace(
        first_member,
        parameters=(*first_member.parameters, *weight),
        terms=(*loop, *stimulus_terms(kind, body, loop)),
        stimulus_unit=STIMULI[kind],
    )


def with_lines(model: Model, lines: Sequence[int]) -> Model:
    """A joint model with other numbers of ``lines`` of its stimuli; a model with one stimulus as it is."""
    if not model.blocks:
        return model
    return replace(model, blocks=tuple(replace(b, lines=n) for b, n in zip(model.blocks, lines, strict=True)))


def _outputs(models: Sequence[Model]) -> tuple[Output, ...]:
    """The outputs of the first model, which hold of every stimulus what those of its own model hold of it."""
    return tuple(
        replace(
            same[0],
            terms=(
                *(t for t in same[0].terms if t.sense != "stimulus"),
                *(replace(t, stimulus=k) for k, o in enumerate(same) for t in o.terms if t.sense == "stimulus"),
            ),
        )
        for same in zip(*(m.outputs for m in models), strict=True)
    )


def _measured(model: Model) -> tuple[Output, ...]:
    """What the outputs hold of the body, without the stimulus."""
    return tuple(replace(o, terms=tuple(t for t in o.terms if t.sense != "stimulus")) for o in model.outputs)


def _loop(model: Model) -> tuple[Term, ...]:
    return tuple(t for t in model.terms if t.sense != "stimulus")
