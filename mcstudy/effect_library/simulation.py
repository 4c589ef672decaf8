"""A recording of a simulated body from a few settings, for `mcstudy simulate` and `mcstudy.simulate`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mcstudy.effect_library.library import effect, library_of
from mcstudy.effect_library.protocol import Protocol, draw_case, simulate_recording
from mcstudy.errors import FallsError, InputError
from mcstudy.recordings.columns import Columns, ModelLike, model_of
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import STIMULI, standing, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.line_stimulus import Stimulus
from mcstudy.stance.noise import DEG2_TO_RAD2, SensorNoise
from mcstudy.stance.ranges import AMPLITUDE, DELAY, GAIN, MAX_SAMPLES, RATE, WEIGHT, Range
from mcstudy.stance.stimulus import Prts

ANY = Range(1e-30, 1e30, or_zero=True, signed=True)
"""Values of a declared model, whose units may be any."""

SMALLER = 20
"""How often randomly drawn sizes are reduced by a quarter when the body falls."""


def simulate(
    effects: Mapping[str, float | None] | Iterable[str] = (),
    *,
    stimulus: str = "ankle_torque",
    waveform: Stimulus | None = None,
    amplitude: float | Sequence[float] | None = None,
    convention: str = "peak",
    cycles: int = 6,
    rate_hz: float = 200.0,
    periodic: bool = True,
    noise: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    name: str = "simulated",
    model: ModelLike | None = None,
    measurement_sd: float | Sequence[float] = 0.0,
) -> Recording:
    """A recording of the nominal two-segment body, or of a declared model, in the time domain, with any effects.

    Parameters
    ----------
    effects
        Size of each effect by name (`mcstudy.effects`), in the effect's unit. None, or a name alone, draws the size
        from its usual range and reduces it until the body is stable.
    stimulus
        ``"ankle_torque"`` (N m), ``"hip_torque"`` (N m), ``"platform_translation"`` (m), ``"surface_tilt"`` or
        ``"visual_tilt"`` (rad). A declared model has a stimulus of its own.
    waveform
        One period of the stimulus, a `mcstudy.stance.stimulus.Prts` or a
        `mcstudy.stance.line_stimulus.LineStimulus`; it replaces ``rate_hz`` and ``convention``. The paper's sequence
        by default.
    amplitude
        Stimulus amplitude of each trial, in that unit; one number for one trial. Two trials of 5 when None, of a
        declared model one of 1.
    convention
        Whether amplitudes are ``"peak"`` or ``"peak_to_peak"`` values.
    cycles
        Stimulus periods per trial, each 43.72 s unless the waveform has another.
    rate_hz
        Sampling rate, Hz.
    periodic
        False gives every trial a random stimulus that never repeats.
    noise
        Amplitude of the sensor noise relative to the paper's; 0 for none. In every angle of a declared model it is that
        of the first one there, in the model's unit where that is not rad.
    parameters
        True values that replace nominal ones, by name, e.g. ``{"Td1": 0.07}``.
    seed
        Random seed of sizes and noise.
    name
        Name of the recording.
    model
        A declared model: a `mcstudy.Model`, its name, or its file; None for `two_segment`.
    measurement_sd
        Standard deviation of white noise on every sample of what is recorded, outside the loop: one number, or one for
        each output, in its unit (deg where that is rad).

    Returns
    -------
    Recording
        One trial per amplitude; ``provenance`` states the sizes.

    Raises
    ------
    InputError
        A value is outside its range; one line that starts with the argument.
    FallsError
        The body is unstable, or falls.
    """
    sizes_given = dict(effects) if isinstance(effects, Mapping) else dict.fromkeys(effects)
    declared = model_of(model)
    if amplitude is None:
        amplitude = (5.0, 5.0) if declared is None else (1.0,)
    amplitudes = (amplitude,) if isinstance(amplitude, int | float) else tuple(amplitude)
    if declared is not None and stimulus != "ankle_torque":
        raise InputError(f"stimulus: expected none for the declared model {declared.name}, got {stimulus!r}")
    if waveform is None:
        RATE.require(rate_hz, "rate_hz")
        waveform = Prts(rate_hz=rate_hz, convention=convention)
    protocol = _protocol("" if declared is not None else stimulus, waveform, amplitudes, cycles, periodic)
    protocol = replace(
        protocol,
        noise=_noise(declared, noise),
        measurement_sd=_measurement(Columns.of(declared, stimulus), measurement_sd),
    )
    Range(0, 2**63 - 1).require(seed, "seed")
    nominal = _with_values(two_segment(stimulus=stimulus) if declared is None else declared, dict(parameters or {}))
    given, drawn = {}, []
    for effect_name, value in sizes_given.items():
        size = effect(effect_name, library_of(nominal)).size
        if value is None:
            drawn.append(effect_name)
        else:
            given[size.name] = size.believable(float(value), f"effect {effect_name}")
    for smaller in range(SMALLER):
        # The streams restart every time, so that the same sizes are drawn, only smaller.
        drawing, running = np.random.default_rng(seed).spawn(2)
        sizes = dict(given)
        try:
            for effect_name in drawn:
                sizes |= draw_case(nominal, [effect_name], drawing, 0.75**smaller, spread=0.0, attempts=20)[1]
            what = ", ".join(f"{k} = {v:.5g}" for k, v in sizes.items()) or "no effect"
            if smaller:
                what += (
                    f" (drawn from {0.75**smaller:.2g} of its usual range, because the body is unstable with "
                    "larger sizes; shorter delays, such as Td1 = 0.06 and Td2 = 0.07, may stabilize it)"
                )
            return simulate_recording(
                protocol,
                nominal.truth,
                running,
                effects=list(sizes_given),
                sizes=sizes,
                model=declared and nominal,
                name=name,
                provenance=f"simulated by mcstudy: {what}; seed {seed}",
            )
        except FallsError:
            if not drawn:
                raise
    raise FallsError(
        f"effect {', '.join(drawn)}: this body is unstable with every size that was tried; give a size or shorter "
        "delays (such as Td1 = 0.06 and Td2 = 0.07)"
    )


def _protocol(
    stimulus: str,
    waveform: Stimulus,
    amplitudes: tuple[float, ...],
    cycles: int,
    periodic: bool,
) -> Protocol:
    Range(1, 100_000).require(cycles, "cycles")
    if stimulus and stimulus not in STIMULI:
        raise InputError(f"stimulus: expected one of {', '.join(STIMULI)}, got {stimulus!r}")
    if not amplitudes:
        raise InputError("amplitude: expected at least one number, got none")
    for peak in amplitudes:
        AMPLITUDE.require(peak, "amplitude")
    if waveform.samples * cycles > MAX_SAMPLES:
        raise InputError(
            f"cycles: expected a trial of at most {MAX_SAMPLES} samples, got {cycles} cycles of {waveform.samples}"
        )
    return Protocol(stimulus=stimulus, waveform=waveform, amplitudes=amplitudes, cycles=cycles, periodic=periodic)


def _noise(declared: Model | None, size: float) -> SensorNoise:
    """Sensor noise of ``size`` times the paper's; of a declared model equal in all angles."""
    Range(1e-6, 1e6, or_zero=True).require(size, "noise")
    psd: tuple[float, ...] = SensorNoise().psd_deg2_hz
    if declared is not None:
        # A noise takes deg^2/Hz; in another unit than rad it has the paper's number in that unit.
        psd = (psd[0] / (1.0 if declared.unit == "rad" else DEG2_TO_RAD2),) * declared.n_rows
    return SensorNoise(tuple(p * size**2 for p in psd))


def _measurement(columns: Columns, sd: float | Sequence[float]) -> tuple[float, ...]:
    """Standard deviations of the noise of all outputs in their units, from those that the user states."""
    given = (sd,) * len(columns.outputs) if isinstance(sd, int | float) else tuple(sd)
    if len(given) != len(columns.outputs):
        raise InputError(f"measurement_sd: expected one number for each of {columns.names}, got {len(given)}")
    for value in given:
        Range(1e-30, 1e30, or_zero=True).require(value, "measurement_sd")
    scaled = (math.radians(x) if unit == "rad" else x for x, unit in zip(given, columns.units, strict=True))
    return tuple(scaled) if any(given) else ()


def _with_values(model: Model, values: Mapping[str, float]) -> Model:
    """The model with other values; bounds are widened to include them."""
    if unknown := set(values) - set(model.names):
        raise InputError(f"parameter: unknown {', '.join(sorted(unknown))}; the model has {', '.join(model.names)}")
    for parameter, value in values.items():
        allowed = DELAY if parameter in model.delays else WEIGHT if parameter in model.weights else GAIN
        if not standing(model):
            allowed = ANY
        allowed.require(value, f"parameter {parameter}")
    theta = {p.name: float(values.get(p.name, p.value)) for p in model.parameters}
    wide = {p.name: (min(theta[p.name], p.lower), max(theta[p.name], p.upper)) for p in model.parameters}
    return model.with_bounds(wide).with_values(theta)
