"""One body under several stimuli: the responses of all of them as those of one model.

The loop is the same whatever moves the body, so a set of recordings with different stimuli has one A(s; theta) and
several b_k(s; theta). A joint model holds the terms of the loop once and the stimulus terms of every kind. Its *blocks*
say which lines belong to which stimulus, so closed form, derivatives and the compiled fits give the responses of all
recordings at once. What changes a model (an effect) changes each of its `members` and joins them again; no effect needs
to know about joint models.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

from mcstudy.errors import ModelError
from mcstudy.stance.body import STIMULI, WEIGHTS, Body, stimulus_terms
from mcstudy.stance.feedback import Block, Filter, Model, Output, OutputTerm, Parameter, Term, any_unit

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

    blocks = tuple(model.blocks[k] for k in stimuli)
    return replace(
        model,
        terms=heard(model.terms),
        outputs=tuple(replace(o, terms=heard(o.terms)) for o in model.outputs),
        stimulus_unit=any_unit(b.unit for b in blocks),
        blocks=blocks,
    )


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
