"""Checks of a group of a study file that need the physics of the model."""

from __future__ import annotations

import numpy as np

from mcstudy.errors import DesignError, InputError, ModelError
from mcstudy.files.untrusted import LARGEST_CHUNK
from mcstudy.models.check import check_response
from mcstudy.models.record import ModelTable
from mcstudy.spectra.bands import PERIOD_S
from mcstudy.stance.body import WEIGHTS
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.ranges import DELAY, GAIN, LARGEST_TILT, MAX_SAMPLES, Range
from mcstudy.stance.response import frf_jacobian
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.study.cube.layout import realizations_a_chunk
from mcstudy.study.detectability import written_out
from mcstudy.study.effects import check_effects
from mcstudy.study.group import GAIN_BOUND, HIGHEST_HZ, UNTIL_CERTAIN, EffectsSection, Group
from mcstudy.study.measure import frequency_points, kept_points, stimulus
from mcstudy.study.models import build_model, simulated_model

MAX_FREQUENCIES = 4000
"""Largest number of frequency points; a cycle of the longest sequence at 20 ms per state has 1600 odd lines to 8 Hz."""

NARROWEST = 1e-12
"""Smallest distance between the bounds of a parameter, in its unit."""

DECLARED_GAIN = Range(1e-30, 1e30, or_zero=True, signed=True)
"""True values and bounds of gains of a declared model, in its own units."""

SMALLEST_RESPONSE = 1e-15
"""Smallest response of an angle, rad per unit of stimulus, and inverse of the largest; humans have about 1e-3."""

SMALLEST_SHARE = 1e-12
"""Of the noise that outputs do not have in common, relative to all of it."""

MAX_CHUNKS = 1_000_000
"""Largest number of chunks of a group; with the largest default chunks this is 5e9 fits."""


def checked(group: Group) -> Group:
    """The group with sizes of effects as numbers; `DesignError`, which starts with the field, for the first mistake."""
    if group.effects == EffectsSection():
        check_group(group)
        return group
    plain = group.model_copy(update={"effects": EffectsSection()})
    check_group(plain)  # the size with a wanted detectability needs a sound group
    base = build_model(plain)
    check_effects(group, base)
    whole = group.model_copy(update={"effects": written_out(group, base)})
    simulated_model(whole)
    check_group(whole)
    return whole


def check_group(group: Group) -> None:
    """Raise `DesignError` for the first mistake; its message starts with the field within the group."""
    model = build_model(group)
    _check_parameters(model, group.model.declared)
    _check_stimulus(group)
    _check_noise(group, model)
    _check_fit(group, model)
    _check_frequencies(group, model)
    _check_response(group, model)
    _check_size(group, model)


def _check_parameters(model: Model, declared: bool) -> None:
    field, gains = ("parameter", DECLARED_GAIN) if declared else ("truth", GAIN)
    for p in model.parameters:
        is_delay = p.name in model.delays
        if is_delay and p.value not in DELAY:
            raise DesignError(f"model.{field}.{p.name}: expected {DELAY}, got {p.value}")
        if not is_delay and p.value not in gains:
            raise DesignError(f"model.{field}.{p.name}: expected {gains}, got {p.value}")
        allowed = DELAY if is_delay else DECLARED_GAIN if declared else GAIN_BOUND
        if p.lower not in allowed or p.upper not in allowed:
            raise DesignError(f"model.bounds: expected {allowed}, got [{p.lower}, {p.upper}] for {p.name}")
        narrowest = NARROWEST * max(abs(p.lower), abs(p.upper)) if declared else NARROWEST
        if p.upper - p.lower < narrowest:
            raise DesignError(
                f"model.bounds: expected bounds at least {narrowest:g} {p.unit} apart, "
                f"got [{p.lower}, {p.upper}] for {p.name}"
            )


def _check_response(group: Group, model: Model) -> None:
    """Refuse a body without inertia, without response to the stimulus, or with a response that overflows."""
    if group.model.declared:
        f = kept_points(group).f
        try:
            check_response(ModelTable.of(model), f[np.linspace(0, f.size - 1, min(5, f.size)).astype(int)])
        except DesignError as error:
            raise DesignError(f"model.{error}") from None
        return
    try:
        with np.errstate(all="ignore"):
            response, slope = frf_jacobian(model, model.truth, kept_points(group).f)
    except np.linalg.LinAlgError:
        response = slope = np.array(np.nan)
    size = np.abs(response)
    if not (np.isfinite(slope).all() and (size > SMALLEST_RESPONSE).all() and (size < 1 / SMALLEST_RESPONSE).all()):
        raise DesignError(
            f"model: expected a response of {SMALLEST_RESPONSE:g} to {1 / SMALLEST_RESPONSE:g} "
            f"rad/({model.stimulus_unit}) at every frequency, got a smaller or larger one"
        )


def _check_highest(group: Group) -> None:
    s, highest = group.stimulus, group.spectra.highest_hz
    if group.model.declared and s.kind != type(s).model_fields["kind"].default:
        raise DesignError(f"stimulus.kind: expected none beside a declared model, whose terms state it, got {s.kind!r}")
    if highest != HIGHEST_HZ and not group.model.declared:
        raise DesignError(f"spectra.highest_hz: expected {HIGHEST_HZ:g} for {group.model.kind}, got {highest:g}")
    if highest != HIGHEST_HZ and group.spectra.points != "odd_lines":
        raise DesignError(
            f"spectra.points: expected 'odd_lines' for highest_hz = {highest:g}, got {group.spectra.points!r}"
        )


def _check_stimulus(group: Group) -> None:
    _check_highest(group)
    s, highest = group.stimulus, group.spectra.highest_hz
    if s.kind in WEIGHTS and (peak := stimulus(group, group.amplitude[-1]).peak) > LARGEST_TILT:
        raise DesignError(f"amplitude: expected a {s.kind} with a peak of at most {LARGEST_TILT} rad, got {peak:g} rad")
    if s.state_s * s.rate_hz > MAX_SAMPLES:
        raise DesignError(f"stimulus.state_s: expected at most {MAX_SAMPLES} samples per state, got {s.state_s} s")
    try:
        prts = stimulus(group, group.amplitude[0])
    except InputError as error:
        raise DesignError(str(error).replace("stimulus ", "stimulus.", 1)) from None
    if s.discard >= s.cycles:
        raise DesignError(f"stimulus.discard: expected fewer than cycles = {s.cycles}, got {s.discard}")
    if prts.samples * s.cycles > MAX_SAMPLES:
        raise DesignError(
            f"stimulus.cycles: expected a record of at most {MAX_SAMPLES} samples, "
            f"got {s.cycles} cycles of {prts.samples}"
        )
    if not s.lines.harmonic and highest * prts.period_s / 2 > MAX_FREQUENCIES:
        raise DesignError(
            f"stimulus.state_s: expected at most {MAX_FREQUENCIES} odd lines up to {highest:g} Hz, "
            f"got a cycle of {prts.period_s:g} s"
        )
    if s.rate_hz < 4 * highest:
        raise DesignError(f"stimulus.rate_hz: expected at least {4 * highest} Hz, got {s.rate_hz}")
    if group.spectra.ramp == "remove" and s.discard == 0:
        raise DesignError(
            "spectra.ramp: expected 'keep' when stimulus.discard = 0 (removing the ramp needs the preceding sample)"
        )
    if group.spectra.points != "odd_lines" and abs(prts.period_s - PERIOD_S) > 1e-9:
        raise DesignError(
            f"spectra.points: expected 'odd_lines' for a period other than {PERIOD_S} s, got {group.spectra.points!r}"
        )
    if group.spectra.points == "odd_lines" and group.spectra.width != 1:
        raise DesignError(
            f"spectra.width: expected 1 for points 'odd_lines' (one line per point), got {group.spectra.width}"
        )


def _check_noise(group: Group, model: Model) -> None:
    try:
        group.noise_source.psd(np.ones(1))
    except InputError as error:
        raise DesignError(str(error).replace("noise ", "noise.", 1)) from None
    try:
        measured = group.measurement_noise
    except InputError as error:
        raise DesignError(f"noise.measurement.{error}") from None
    _check_margin(group, model)
    if group.spectra.covariance != "even_lines" and (measured is not None or model.outputs):
        raise DesignError(
            "spectra.covariance: expected 'even_lines' for declared outputs and measurement noise, which is not of the "
            "loop, got 'through_loop'"
        )


def _check_margin(group: Group, model: Model) -> None:
    """Raise `DesignError` for a margin that the true loop does not keep."""
    if (margin := group.fit.stability_margin) is None:
        return
    from mcstudy.stance.stability import growth_rate  # loads compiled code

    growth = float(growth_rate(model, model.truth))
    if growth > -margin:
        raise DesignError(
            f"fit.stability_margin: expected at most {max(-growth, 0.0):.3g} 1/s, with which the loop of the true "
            f"parameters decays, got {margin:g}"
        )


def noisy_outputs(group: Group, model: Model) -> bool:
    """Whether the errors of a group's responses have a covariance that can be inverted."""
    if group.simulator == "none":
        return False
    measured = group.measurement_noise
    recorded = None if measured is None else measured.psd(group.stimulus.rate_hz)
    density = sway_psd(members(model)[0], model.truth, group.noise_source, kept_points(group).f, recorded)
    size = np.sqrt(np.einsum("nii->ni", density).real)
    if not (size > 0).all():
        return False
    return bool(np.linalg.eigvalsh(density / size[:, :, None] / size[:, None, :])[:, 0].min() > SMALLEST_SHARE)


def _check_fit(group: Group, model: Model) -> None:
    if group.until_certain and group.fit.starts == "latin_hypercube":
        raise DesignError(
            f"fit.starts: expected another kind for starts = {UNTIL_CERTAIN!r}, because Latin hypercube starts depend "
            "on their number, got 'latin_hypercube'"
        )
    if group.fit.starts == "linearised":
        from mcstudy.fitting.linearised import require_linear  # other studies need no SciPy to be read

        try:
            require_linear(model)
        except ModelError as error:
            raise DesignError(f"fit.starts: {error}") from None
    if group.spectra.covariance == "through_loop" and (group.fit.cost != "ml" or group.simulator != "spectral"):
        raise DesignError(
            "spectra.covariance: expected 'even_lines' unless fit.cost = 'ml' and simulator = 'spectral', "
            f"got {group.spectra.covariance!r}"
        )
    weighted = group.fit.cost == "ml" or group.store.standard_errors
    without = weighted and not noisy_outputs(group, model)
    if group.fit.cost == "ml" and without:
        raise DesignError(
            "fit.cost: expected 'paper' for a group without noise (no noise covariance to weight with), got 'ml'"
        )
    if group.store.standard_errors and without:
        raise DesignError("store.standard_errors: expected false for a group without noise on all outputs, got true")


def _check_frequencies(group: Group, model: Model) -> None:
    points, half_line = frequency_points(group).f, 0.5 / stimulus(group, group.amplitude[0]).period_s
    check_fmax(group.fmax[0], group.fmax[-1], points, half_line, "fmax", group.spectra.highest_hz)
    for f in group.spectra.exclude_hz:
        if np.abs(points - f).min() > half_line:
            raise DesignError(f"spectra.exclude_hz: expected frequencies of the FRF, got {f}")
    try:
        smallest = len(model.stimulus_names) * len(kept_points(group).below(group.fmax[0]))
    except InputError:
        smallest = 0
    check_determined(smallest, model, group.fmax[0], "fmax")


def check_fmax(
    lowest: float, highest: float, points: np.ndarray, half_line: float, field: str, last: float = HIGHEST_HZ
) -> None:
    """Raise `DesignError` unless both fmax (Hz) are within half a line of the frequency points (N,)."""
    last = max(points[-1], last)
    if lowest < points[0] - half_line:
        raise DesignError(f"{field}: expected at least {points[0]:.4g} Hz, the first frequency, got {lowest}")
    if highest > last + half_line:
        raise DesignError(f"{field}: expected at most {last:.4g} Hz, the last frequency, got {highest}")


def check_determined(frequencies: int, model: Model, fmax: float, field: str) -> None:
    """Raise `DesignError` unless the frequencies up to ``fmax`` give as many numbers as there are parameters."""
    parameters, a_frequency = len(model.parameters), 2 * model.n_outputs
    if a_frequency * frequencies < parameters:
        raise DesignError(
            f"{field}: expected at least {-(-parameters // a_frequency)} frequencies for {parameters} parameters, "
            f"got {frequencies} up to {fmax} Hz"
        )


def _realization_bytes(group: Group, parameters: int, frequencies: int, outputs: int) -> int:
    """Bytes of the results of one realization at one amplitude, uncompressed (`mcstudy.study.cube.layout`)."""
    a_fit = 2 * 8 * parameters + parameters + 8 + 8 + 4 + 1
    errors = 8 * parameters if group.store.standard_errors else 0
    return (a_fit * group.starts + errors) * len(group.fmax) + 16 * (outputs + outputs**2) * frequencies


def _check_size(group: Group, model: Model) -> None:
    """Limits of the memory that a run needs at once, and of the number of files."""
    cell = len(group.fmax) * group.starts
    depth = realizations_a_chunk(group)
    size = depth * _realization_bytes(
        group, len(model.parameters), len(model.stimulus_names) * len(kept_points(group).f), model.n_outputs
    )
    if size > LARGEST_CHUNK:
        raise DesignError(
            f"starts: expected a chunk of at most {LARGEST_CHUNK} bytes, got {size} "
            f"({depth} realizations x {len(group.fmax)} fmax x {group.starts} starts)"
        )
    chunks = len(group.amplitude) * -(-group.realizations // depth)
    if chunks > MAX_CHUNKS:
        raise DesignError(
            f"realizations: expected at most {MAX_CHUNKS} chunks, got {chunks} "
            f"({group.realizations} realizations x {len(group.amplitude)} amplitudes, {depth * cell} fits in each)"
        )
