"""The model that a study file describes: a registered kind with its own true values, body and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, replace

from mcstudy.errors import DesignError, ModelError
from mcstudy.models.catalogue import DECLARED
from mcstudy.models.record import table_of
from mcstudy.stance.body import PASSIVE, SINGLE, Body, one_segment, two_segment
from mcstudy.stance.feedback import Model, Parameter
from mcstudy.stance.joint import under_some
from mcstudy.stance.provenance import BODY, OWN_VALUES, REPLACED, WEIGHT, own_values, stand_in
from mcstudy.stance.truths import TRUTHS, named
from mcstudy.study import effects
from mcstudy.study.group import BoundsSection, EffectsSection, Group, ModelSection


def build_model(group: Group) -> Model:
    """The model that a group fits, with the effects that are fitted.

    Raises
    ------
    DesignError: with a message that starts with the field, relative to the group.
    """
    base = base_model(group)
    return base if group.effects == EffectsSection() else effects.fitted(base, group.effects)


def simulated_model(group: Group) -> Model:
    """The model of the body that a group simulates; its ``truth`` are the values of all its parameters."""
    return effects.simulated(base_model(group), group.effects)


def base_model(group: Group) -> Model:
    """The model of a group without any effects; raises as `build_model`."""
    section = group.model
    if section.declared:
        return _applied(_declared(section), group.stimulus.applied)
    if group.stimulus.applied:
        raise DesignError(f"stimulus.applied: expected a declared model with several stimuli, got {section.kind}")
    body_fields = [f.name for f in fields(Body)]
    for name in section.body:
        if name not in body_fields:
            raise DesignError(f"model.body.{name}: unknown key, expected one of {', '.join(body_fields)}")
    try:
        body = Body(**section.body)
    except ModelError as error:
        raise DesignError(f"model.{error}") from error
    if section.kind == "one_segment":
        if group.stimulus.kind not in SINGLE:
            raise DesignError(
                f"stimulus.kind: expected one of {', '.join(SINGLE)} for one_segment, got {group.stimulus.kind!r}"
            )
        model = one_segment(body, group.stimulus.kind)
    else:
        model = two_segment(body, group.stimulus.kind)
    _check_names(section, model.names)
    parameters = tuple(
        _parameter(p, section.truth.get(p.name, p.value), model, section.bounds) for p in model.parameters
    )
    values = {p.name: p.value for p in parameters}
    replaced = [p.name for p in model.parameters if p.value != values[p.name]]
    return replace(model, parameters=parameters, provenance=_provenance(model, values, replaced, body != Body()))


def _declared(section: ModelSection) -> Model:
    """The model of a table, with the true values and bounds that the section states beside it."""
    _check_names(section, [p.name for p in section.parameter])
    changed = []
    for p in section.parameter:
        value = section.truth.get(p.name, p.value)
        lower, upper = section.bounds.absolute.get(p.name, (p.lower, p.upper))
        changed.append(p.model_copy(update={"value": value, "lower": lower, "upper": upper}))
    replaced = REPLACED + ", ".join(section.truth) if section.truth and section.provenance else ""
    provenance = (section.provenance or OWN_VALUES) + replaced
    bounds = section.bounds
    table = section.model_copy(update={"parameter": tuple(changed), "provenance": provenance})
    try:
        return table.model(bounds.lower, bounds.upper, bounds.delay_margin_s)
    except DesignError as error:
        raise DesignError(f"model.{error}") from None


def _applied(model: Model, names: tuple[str, ...]) -> Model:
    """The model under some of its stimuli; all by default."""
    for name in names:
        if name not in model.stimulus_names or not model.blocks:
            raise DesignError(f"stimulus.applied: expected one of {', '.join(model.stimulus_names)}, got {name!r}")
    if len(set(names)) < len(names):
        raise DesignError(f"stimulus.applied: expected every stimulus once, got {', '.join(names)}")
    return under_some(model, [model.stimulus_names.index(name) for name in names]) if names else model


def _check_names(section: ModelSection, known: Sequence[str]) -> None:
    for field, names in (("truth", section.truth), ("bounds.absolute", section.bounds.absolute)):
        for name in names:
            if name not in known:
                raise DesignError(f"model.{field}.{name}: unknown parameter, expected one of {', '.join(known)}")


def _provenance(model: Model, values: dict[str, float], replaced: list[str], own_body: bool) -> str:
    """Where the true values of a model come from; ``replaced``: parameters whose value is not the reference model's."""
    weights, own = [name for name in values if name in model.weights], [BODY] if own_body else []
    if named({name: value for name, value in values.items() if name not in weights}) == "inferred":
        own += [name for name in weights if name in replaced]
        weight = f"; {WEIGHT}" if set(weights) - set(replaced) else ""
        return TRUTHS["inferred"].provenance + weight + (REPLACED + ", ".join(own) if own else "")
    if len(replaced) == len(values):
        return own_values(own_body)
    return stand_in(PASSIVE[model.name], [*own, *replaced], weights)


def earlier_provenance(group: Group) -> str:
    """Where the true values of a group come from in the words of older programs, which call any body the paper's."""
    if group.model.declared:
        return build_model(group).provenance
    reference = (one_segment if group.model.kind == "one_segment" else two_segment)(stimulus=group.stimulus.kind)
    values = {p.name: group.model.truth.get(p.name, p.value) for p in reference.parameters}
    if name := named(values):
        return TRUTHS[name].provenance
    replaced = [p.name for p in reference.parameters if p.value != values[p.name]]
    text = stand_in("Kpas1", (), [""] if reference.weights else [])
    return text + (REPLACED + ", ".join(replaced) if replaced else "")


def with_model_values(group: Group) -> Group:
    """The group with all true values and body constants written out, so that new defaults do not change a study."""
    if group.model.declared:
        declared = _declared(group.model)
        return group.model_copy(update={"model": ModelSection(kind=DECLARED, **table_of(declared))})
    model = base_model(group)
    truth = {p.name: p.value for p in model.parameters}
    section = group.model.model_copy(update={"truth": truth, "body": asdict(Body(**group.model.body))})
    return group.model_copy(update={"model": section})


def _parameter(parameter: Parameter, value: float, model: Model, bounds: BoundsSection) -> Parameter:
    name = parameter.name
    if name in bounds.absolute:
        lower, upper = bounds.absolute[name]
        where = f"model.bounds.absolute.{name}"
    elif name in model.weights:
        lower, upper = parameter.lower, parameter.upper
        where = f"model.truth.{name}"
    elif name in model.delays:
        lower, upper = value - bounds.delay_margin_s, value + bounds.delay_margin_s
        where = "model.bounds.delay_margin_s"
        if lower < 0:
            raise DesignError(f"{where}: expected at most the delay {name} = {value} s, got {bounds.delay_margin_s}")
    else:
        if not bounds.lower < bounds.upper:
            raise DesignError(f"model.bounds: expected lower < upper, got lower {bounds.lower}, upper {bounds.upper}")
        lower, upper = sorted((bounds.lower * value, bounds.upper * value))
        where = "model.bounds"
    if not lower < upper:
        raise DesignError(f"{where}: expected lower < upper, got [{lower}, {upper}] for {name}")
    if not lower <= value <= upper:
        raise DesignError(f"model.truth.{name}: expected a value inside its bounds [{lower}, {upper}], got {value}")
    try:
        return replace(parameter, value=value, lower=lower, upper=upper)
    except ModelError as error:
        raise DesignError(f"model: {error}") from None
