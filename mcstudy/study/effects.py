"""Effects of the library in a study: the body that is simulated and the model that is fitted are two models.

Both begin with the model of the group. What the body has and the fitted model lacks biases its parameters; what the
fitted model has and the body lacks costs precision.

A size may be stated by its detectability *delta*, the square root of the noncentrality that `mcstudy.gap` uses: the
length of the change of the responses, in standard deviations of their errors at the lines up to the largest Fmax and at
the largest amplitude, that remains after the parameters of the model have absorbed what they can to first order. The
errors are those of this body's sway in theory, without the leakage of a finite record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect, Size, TrialSetting
from mcstudy.errors import DesignError, InputError, ModelError
from mcstudy.files.plain_errors import nearest
from mcstudy.stance.feedback import Model
from mcstudy.stance.information import expected_line_covariance, unit_variance
from mcstudy.stance.joint import members
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.stance.stability import growth_rate
from mcstudy.study.group import EffectsSection, Group
from mcstudy.study.measure import kept_points, stimulus

DELTA = "delta"
"""What stands in the table of an effect in place of its size."""

FIRST, ROUNDS = 1e-6, 60
"""Size from which the one with a wanted delta is searched, as a fraction of the usual one, and steps of the search."""


def declared(name: str, field: str) -> Effect:
    """The effect of this name; `DesignError` begins with ``field``."""
    if name not in library.LIBRARY:
        raise DesignError(f"{field}: unknown effect{nearest(name, library.LIBRARY)}; mcstudy gap effects lists all")
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
    return _with_sizes(base, linear, true_sizes(section)) if linear else base


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
    return {"rules": library.rules(nonlinear(section), true_sizes(section), trial), "substeps": substeps}


def _with_sizes(base: Model, names: tuple[str, ...], sizes: Mapping[str, float]) -> Model:
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


def written_out(group: Group, base: Model) -> EffectsSection:
    """The section with every size as a number, and with the reference amplitude where an effect needs it."""
    section = group.effects
    truth: dict[str, float | dict[str, float]] = {}
    for name, effect in true_effects(section).items():
        given = section.truth[name]
        if isinstance(given, dict) and DELTA in given:
            given = _of_delta(group, base, effect, given)
        sizes = true_sizes(EffectsSection(truth={name: given}))
        truth[name] = sizes if len(sizes) > 1 else sizes[effect.size.name]
    update: dict[str, object] = {"truth": truth}
    if nonlinear(section) and section.reference_amplitude is None:
        update["reference_amplitude"] = float(np.exp(np.mean(np.log(group.amplitude))))
    return section.model_copy(update=update)


def _of_delta(group: Group, base: Model, effect: Effect, given: Mapping[str, float]) -> dict[str, float]:
    """The table of an effect with the size that has the stated delta."""
    field, wanted = f"effects.truth.{effect.name}.{DELTA}", given[DELTA]
    if effect.kind != "linear":
        raise DesignError(f"{field}: expected the size {effect.size.name} of an effect without a closed form")
    if effect.size.name in given:
        raise DesignError(f"{field}: expected no {effect.size.name} beside it")
    if wanted < 0 and not effect.size.signed:
        raise DesignError(f"{field}: expected a positive number for an effect with one sign, got {wanted:g}")
    if group.simulator == "none" or group.noise.none:
        raise DesignError(f"{field}: expected a group with noise, in which an effect can be more or less detectable")
    shapes = {s.name: given.get(s.name, s.parameter.value) for s in effect.sizes[1:]}
    delta = detectability(group, base, effect, shapes)
    return {**shapes, effect.size.name: _solved(delta, effect.size, wanted, field)}


def detectability(group: Group, base: Model, effect: Effect, shapes: Mapping[str, float]) -> Callable[[float], float]:
    """The function from the size of a linear effect to its delta (see the module); infinite for a body that falls."""
    bands, s = kept_points(group).below(group.fmax[-1]), group.stimulus
    f = bands.line_f
    drive = stimulus(group, group.amplitude[-1]).coefficients()[bands.lines]
    duration_s = (s.cycles - s.discard) * bands.period_s
    measured = group.measurement_noise
    recorded = None if measured is None else measured.psd_without_ramp(f, duration_s, s.rate_hz)
    J, points = len(base.stimulus_names), np.repeat(f, len(base.stimulus_names))
    rest, slope = frf_jacobian(base, base.truth, points)
    slope = slope * np.abs(base.upper - base.lower)

    def delta(size: float) -> float:
        body = _with_sizes(base, (effect.name,), {**shapes, effect.size.name: size})
        if not float(growth_rate(body, body.truth)) < 0:
            return np.inf
        noise = group.noise_source
        C = expected_line_covariance(members(body)[0], body.truth, noise, f, drive, duration_s, recorded)
        weight = np.repeat(unit_variance(C, base.n_angles), J, axis=0)
        change = _real(weight, (frf(body, body.truth, points) - rest)[..., None])[:, 0]
        absorbed = _real(weight, slope)
        return float(np.linalg.norm(change - absorbed @ np.linalg.lstsq(absorbed, change, rcond=None)[0]))

    return delta


def _real(weight: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Changes (N, Y, P) of responses in standard deviations of real and imaginary parts, (2 N Y, P)."""
    white = np.einsum("nij,njp->nip", weight, change).reshape(-1, change.shape[-1])
    return np.concatenate([white.real, white.imag])


def _solved(delta: Callable[[float], float], size: Size, wanted: float, field: str) -> float:
    """The size with this delta, by bisection between the null and the bound of the fit."""
    null, sign = size.parameter.value, np.copysign(1.0, wanted)
    limit = abs((size.upper if sign > 0 else size.lower) - null)
    low, high = 0.0, min(FIRST * size.published[1], limit)
    while (at := delta(null + sign * high)) < abs(wanted) and high < limit:
        low, high = high, min(2 * high, limit)
    if at < abs(wanted):
        raise DesignError(
            f"{field}: expected at most {at:.3g}, that of the largest size that is fitted, got {wanted:g}"
        )
    for _ in range(ROUNDS):
        middle = (low + high) / 2
        low, high = (middle, high) if delta(null + sign * middle) < abs(wanted) else (low, middle)
    if not np.isfinite(delta(null + sign * high)) and delta(null + sign * low) < 0.99 * abs(wanted):
        raise DesignError(f"{field}: expected less than {wanted:g}, at which the body falls")
    return float(f"{null + sign * low:.6g}")
