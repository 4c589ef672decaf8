"""Sizes of effects by how well an experiment could show them.

A size may be stated by its detectability *delta*, the square root of the noncentrality that `mcstudy.gap` uses: the
length of the change of the responses, in standard deviations of their errors at the lines up to the largest Fmax and at
the largest amplitude, that remains after the parameters of the model have absorbed what they can to first order. The
errors are those of this body's sway in theory, without the leakage of a finite record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mcstudy.effect_library.effect import Effect, Size
from mcstudy.errors import DesignError
from mcstudy.stance.feedback import Model
from mcstudy.stance.information import expected_line_covariance, unit_variance
from mcstudy.stance.joint import members
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.study.effects import DELTA, nonlinear, true_effects, true_sizes, with_sizes
from mcstudy.study.group import EffectsSection, Group
from mcstudy.study.measure import kept_points, stimulus

FIRST, ROUNDS = 1e-6, 60
"""Size from which the one with a wanted delta is searched, as a fraction of the usual one, and steps of the search."""


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
        body = with_sizes(base, (effect.name,), {**shapes, effect.size.name: size})
        from mcstudy.stance.stability import growth_rate  # loads compiled code

        if not float(growth_rate(body, body.truth)) < 0:
            return np.inf
        noise = group.noise_source
        C = expected_line_covariance(members(body)[0], body.truth, noise, f, drive, duration_s, recorded)
        weight = np.repeat(unit_variance(C), J, axis=0)
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
