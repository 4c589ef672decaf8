"""A recording of a simulated body from a few settings, for `mcstudy simulate` and `mcstudy.simulate`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mcstudy.effect_library.library import effect
from mcstudy.effect_library.protocol import Protocol, draw_case, simulate_recording
from mcstudy.errors import FallsError, InputError
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import STIMULI, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.line_stimulus import Stimulus
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.ranges import AMPLITUDE, DELAY, GAIN, MAX_SAMPLES, RATE, WEIGHT, Range
from mcstudy.stance.stimulus import Prts

SMALLER = 20
"""How often randomly drawn sizes are reduced by a quarter when the body falls."""


def simulate(
    effects: Mapping[str, float | None] | Iterable[str] = (),
    *,
    stimulus: str = "ankle_torque",
    waveform: Stimulus | None = None,
    amplitude: float | Sequence[float] = (5.0, 5.0),
    convention: str = "peak",
    cycles: int = 6,
    rate_hz: float = 200.0,
    periodic: bool = True,
    noise: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    seed: int = 0,
    name: str = "simulated",
) -> Recording:
    """A recording of the nominal two-segment body in the time domain, with any effects of the library.

    Parameters
    ----------
    effects
        Size of each effect by name (`mcstudy.effects`), in the effect's unit. None, or a name alone, draws the size
        from its usual range and reduces it until the body is stable.
    stimulus
        ``"ankle_torque"`` (N m), ``"hip_torque"`` (N m), ``"platform_translation"`` (m), ``"surface_tilt"`` or
        ``"visual_tilt"`` (rad).
    waveform
        One period of the stimulus, a `mcstudy.stance.stimulus.Prts` or a
        `mcstudy.stance.line_stimulus.LineStimulus`; it replaces ``rate_hz`` and ``convention``. The paper's sequence
        by default.
    amplitude
        Stimulus amplitude of each trial, in that unit; one number for one trial.
    convention
        Whether amplitudes are ``"peak"`` or ``"peak_to_peak"`` values.
    cycles
        Stimulus periods per trial, each 43.72 s unless the waveform has another.
    rate_hz
        Sampling rate, Hz.
    periodic
        False gives every trial a random stimulus that never repeats.
    noise
        Amplitude of the sensor noise relative to the paper's; 0 for none.
    parameters
        True values that replace nominal ones, by name, e.g. ``{"Td1": 0.07}``.
    seed
        Random seed of sizes and noise.
    name
        Name of the recording.

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
    amplitudes = (amplitude,) if isinstance(amplitude, int | float) else tuple(amplitude)
    if waveform is None:
        RATE.require(rate_hz, "rate_hz")
        waveform = Prts(rate_hz=rate_hz, convention=convention)
    protocol = _protocol(stimulus, waveform, amplitudes, cycles, periodic, noise)
    Range(0, 2**63 - 1).require(seed, "seed")
    nominal = _model(stimulus, dict(parameters or {}))
    given, drawn = {}, []
    for effect_name, value in sizes_given.items():
        size = effect(effect_name).size
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
    noise: float,
) -> Protocol:
    Range(1e-6, 1e6, or_zero=True).require(noise, "noise")
    Range(1, 100_000).require(cycles, "cycles")
    if stimulus not in STIMULI:
        raise InputError(f"stimulus: expected one of {', '.join(STIMULI)}, got {stimulus!r}")
    if not amplitudes:
        raise InputError("amplitude: expected at least one number, got none")
    for peak in amplitudes:
        AMPLITUDE.require(peak, "amplitude")
    if waveform.samples * cycles > MAX_SAMPLES:
        raise InputError(
            f"cycles: expected a trial of at most {MAX_SAMPLES} samples, got {cycles} cycles of {waveform.samples}"
        )
    psd = SensorNoise().psd_deg2_hz
    return Protocol(
        stimulus=stimulus,
        waveform=waveform,
        amplitudes=amplitudes,
        cycles=cycles,
        periodic=periodic,
        noise=SensorNoise((psd[0] * noise**2, psd[1] * noise**2)),
    )


def _model(stimulus: str, values: Mapping[str, float]) -> Model:
    """The nominal model with other values; bounds are widened to include them."""
    model = two_segment(stimulus=stimulus)
    if unknown := set(values) - set(model.names):
        raise InputError(f"parameter: unknown {', '.join(sorted(unknown))}; the model has {', '.join(model.names)}")
    for parameter, value in values.items():
        allowed = DELAY if parameter in model.delays else WEIGHT if parameter in model.weights else GAIN
        allowed.require(value, f"parameter {parameter}")
    theta = {p.name: float(values.get(p.name, p.value)) for p in model.parameters}
    wide = {p.name: (min(theta[p.name], p.lower), max(theta[p.name], p.upper)) for p in model.parameters}
    return model.with_bounds(wide).with_values(theta)
