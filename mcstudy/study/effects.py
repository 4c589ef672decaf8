"""Effects of the library in a study: the body that is simulated and the model that is fitted are two models.

Both begin with the model of the group. What the body has and the fitted model lacks biases its parameters; what the
fitted model has and the body lacks costs precision.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect, TrialSetting
from mcstudy.errors import DesignError, FallsError, InputError, ModelError
from mcstudy.stance.feedback import Model
from mcstudy.study.group import EffectsSection, Group
from mcstudy.text_tables import similar

DELTA = "delta"
"""What stands in the table of an effect in place of its size."""


def declared(name: str, field: str) -> Effect:
    """The effect of this name; `DesignError` begins with ``field``."""
    if name not in library.LIBRARY:
        raise DesignError(f"{field}: unknown effect{similar(name, library.LIBRARY)}; mcstudy gap effects lists all")
    return library.LIBRARY[name]


def true_effects(section: EffectsSection) -> dict[str, Effect]:
    """The effects of the body that is simulated, by name."""
    return {name: declared(name, f"effects.truth.{name}") for name in section.truth}


def true_sizes(section: EffectsSection) -> dict[str, float]:
    """Every parameter of the effects of the body; shape parameters that are not stated are in the middle."""
    values: dict[str, float] = {}
    for name, effect in true_effects(section).items():
        given, field = section.truth[name], f"effects.truth.{name}"
        table = given if isinstance(given, dict) else {effect.size.name: given}
        for key in table:
            if key not in effect.parameters:
                one_of = ", ".join((*effect.parameters, DELTA))
                raise DesignError(f"{field}.{key}: unknown parameter, expected one of {one_of}")
        if effect.size.name not in table:
            raise DesignError(f"{field}: expected its size {effect.size.name}, or {DELTA}")
        values |= {s.name: table.get(s.name, s.parameter.value) for s in effect.sizes}
    return values


def fitted(base: Model, section: EffectsSection) -> Model:
    """``base`` with the effects that are fitted; their true values are the sizes of the body, or none."""
    model = base
    for k, name in enumerate(section.fit):
        if declared(name, f"effects.fit[{k}]").kind != "linear":
            raise DesignError(
                f"effects.fit[{k}]: expected an effect with a closed form, got {name!r}, "
                f"which is {library.LIBRARY[name].kind}"
            )
    if section.fit:
        model = _applied(base, section.fit, "effects.fit")
    sizes = {n: v for n, v in true_sizes(section).items() if n in model.names}
    for p in model.parameters:
        if p.name in sizes and not p.lower <= sizes[p.name] <= p.upper:
            raise DesignError(
                f"effects.truth: expected {p.name} between the bounds {p.lower:g} and {p.upper:g} of its fit, "
                f"got {sizes[p.name]:g}"
            )
    return model.with_values(sizes)


def simulated(base: Model, section: EffectsSection) -> Model:
    """``base`` with the linear effects of the body at their sizes; rules of the others are in `rules_of`."""
    linear = tuple(n for n, e in true_effects(section).items() if e.kind == "linear")
    return with_sizes(base, linear, true_sizes(section)) if linear else base


def nonlinear(section: EffectsSection) -> tuple[str, ...]:
    """Names of the effects of the body that have no closed form."""
    return tuple(n for n, e in true_effects(section).items() if e.kind != "linear")


def in_time(group: Group, model: Model, amplitude: float, samples: int, rng: np.random.Generator) -> dict[str, Any]:
    """Settings of the time simulator for a record of ``samples`` at one amplitude of the body ``model``.

    They are the rules of its effects without a closed form, and steps for its fastest lags; none without effects.
    """
    from mcstudy.effect_library.protocol import substeps_of  # who only reads a study simulates nothing

    section = group.effects
    if not section.truth:
        return {}
    substeps = substeps_of(model, model.truth, group.stimulus.rate_hz)
    reference = amplitude if section.reference_amplitude is None else section.reference_amplitude
    trial = TrialSetting(model, amplitude, reference, samples, group.stimulus.rate_hz, rng)
    return {"rules": library.rules(true_effects(section).values(), true_sizes(section), trial), "substeps": substeps}


def refuse_fallen(group: Group, recorded: np.ndarray, amplitude: float) -> None:
    """Raise `FallsError` for a record (n, Y) of a body that falls with its effects, which has no response."""
    from mcstudy.recordings.checks import LARGEST_SWAY

    limit = np.inf if group.model.declared else LARGEST_SWAY
    if group.effects.truth and not np.abs(recorded).max() < limit:
        sizes = ", ".join(f"{name} = {value:.4g}" for name, value in true_sizes(group.effects).items())
        raise FallsError(f"effects.truth: the body falls with {sizes} at amplitude {amplitude:g}; reduce a size")


def with_sizes(base: Model, names: tuple[str, ...], sizes: Mapping[str, float]) -> Model:
    """``base`` with linear effects at these sizes, which may lie outside the bounds of a fit."""
    model = _applied(base, names, "effects.truth")
    values = {p.name: sizes.get(p.name, p.value) for p in model.parameters}
    wide = {p.name: (min(values[p.name], p.lower), max(values[p.name], p.upper)) for p in model.parameters}
    return model.with_bounds(wide).with_values(values)


def _applied(base: Model, names: tuple[str, ...], field: str) -> Model:
    try:
        return library.apply(base, *names)
    except (InputError, ModelError) as error:
        raise DesignError(f"{field}: {error}") from None


def check_effects(group: Group, base: Model) -> None:
    """Raise `DesignError` for effects that the group cannot simulate or fit."""
    section = group.effects
    if (names := nonlinear(section)) and group.simulator != "time_domain":
        raise DesignError(
            f"simulator: expected 'time_domain' for {names[0]}, which has no closed form, got {group.simulator!r}"
        )
    if names and len(base.stimulus_names) > 1:
        raise DesignError(f"effects.truth.{names[0]}: expected an effect with a closed form beside several stimuli")
    if section.truth and group.spectra.covariance == "through_loop":
        raise DesignError("spectra.covariance: expected 'even_lines' beside effects.truth, got 'through_loop'")
