"""Recordings with mislabelled channels, trials, clocks or bodies, and the sound recordings from which they are made.

A sound recording comes from the time-domain simulator; a mislabelling changes its channels as a laboratory might. Every
`Mislabelling` states which codes of `mcstudy.lines.labels` describe it, so a refusal or a named cause can be
judged right or wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol, draw_case, simulate_recording
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.stance.anthropometry import segments
from mcstudy.stance.body import Body
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.stimulus import Prts

QUIET = 0.2
"""Amplitude of the sensor noise of a quiet recording, relative to the usual one."""

RATE_HZ = 100.0

STILL = 1e-4
"""Amplitude of a stimulus that nobody answers, N m."""

KINDS = 7
"""Number of kinds of sound recordings; `sound` repeats them with other seeds."""

STATURE_M, MASS_KG, SPREAD = 1.75, 76.0, 0.20
"""Height and mass of the usual person, and the largest relative change of a drawn person's mass; the height changes by
a third of it."""

LOW_PASS_HZ = 3.0
"""Corner of the filter of a low-passed channel."""


@dataclass(frozen=True)
class Sound:
    """A sound recording, the segments of its body, and the effect of the library that it has, empty without one.

    ``still``: makes the recording of the same person without a stimulus.
    """

    recording: Recording
    segments: dict[str, float]
    effect: str
    still: Callable[[], Recording]


def sound(seed: int) -> Sound:
    """One sound recording; the seed modulo `KINDS` decides its kind.

    0 two trials at 5 N m; 1 trials at 3 and 5 N m; 2, 3 the same with little noise; 4, 5 another person, usual and
    little noise; 6 trials at 3 and 5 N m of a person with one linear effect of the library, drawn with its size.
    """
    kind, rng = seed % KINDS, np.random.default_rng([seed, 14])
    height, mass = STATURE_M, MASS_KG
    if kind in (4, 5):
        height *= 1 + rng.uniform(-SPREAD, SPREAD) / 3
        mass *= 1 + rng.uniform(-SPREAD, SPREAD)
    parts = dict(segments(height, mass, None, None))
    body = Body.from_segments(**parts)
    # A recording knows the model whose gains are scaled to its body; any recording of this body will do.
    model = Recording((Trial(np.ones(10), np.ones((10, 2))),), RATE_HZ, None, body=body).base_model()
    effects = [str(rng.choice(PHYSIOLOGICAL))] if kind == 6 else []
    theta, sizes = draw_case(model, effects, rng)
    protocol = Protocol(
        waveform=Prts(rate_hz=RATE_HZ),
        amplitudes=(5.0, 5.0) if kind in (0, 3) else (3.0, 5.0),
        noise=SensorNoise(psd_deg2_hz=_power(QUIET if kind in (2, 3, 5) else 1.0)),
    )

    def simulated(of: Protocol) -> Recording:
        name = f"recording {seed}"
        return simulate_recording(of, theta, rng, effects=effects, sizes=sizes, model=model, body=body, name=name)

    nothing = replace(protocol, amplitudes=(STILL,) * len(protocol.amplitudes))
    return Sound(simulated(protocol), parts, "".join(effects), lambda: simulated(nothing))


def _power(amplitude: float) -> tuple[float, float]:
    first, second = SensorNoise().psd_deg2_hz
    return amplitude**2 * first, amplitude**2 * second


PHYSIOLOGICAL = tuple(
    e.name for e in library.LIBRARY.values() if e.kind == "linear" and set(e.place) <= {"ankle", "hip", "body"}
)
"""Linear effects of the library that act in the body."""


@dataclass(frozen=True)
class Mislabelling:
    """One way to mislabel a recording.

    Attributes
    ----------
    name: in words. change: returns the mislabelled recording. codes: readings that describe it, effects that do the
        same, or parts of the message of a refusal, which hold a space.
    """

    name: str
    change: Callable[[Sound], Recording]
    codes: tuple[str, ...]


def _trials(change: Callable[[Trial], Trial], only: int | None = None) -> Callable[[Sound], Recording]:
    """Change every trial, or the trial ``only``; stated amplitudes, which would betray the change, are left out."""

    def changed(it: Sound) -> Recording:
        trials = [change(t) if only in (None, k) else t for k, t in enumerate(it.recording.trials)]
        return replace(it.recording, trials=tuple(replace(t, amplitude=None) for t in trials))

    return changed


def _scaled(stimulus: float = 1.0, theta1: float = 1.0, theta2: float = 1.0) -> Callable[[Trial], Trial]:
    return lambda t: replace(t, stimulus=stimulus * t.stimulus, theta=t.theta * np.array([theta1, theta2]))


def _channels(which: tuple[int, ...], change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Trial], Trial]:
    """Apply a function of (n,) samples to the angles ``which``."""

    def changed(t: Trial) -> Trial:
        theta = t.theta.copy()
        for k in which:
            theta[:, k] = change(theta[:, k])
        return replace(t, theta=theta)

    return changed


def _derivative(x: np.ndarray) -> np.ndarray:
    return np.gradient(x) * RATE_HZ


def _integral(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.cumsum(x - x.mean()) / RATE_HZ)


def _late(seconds: float) -> Callable[[np.ndarray], np.ndarray]:
    n = round(seconds * RATE_HZ)
    return lambda x: np.concatenate([np.full(max(n, 0), x[0]), x, np.full(max(-n, 0), x[-1])])[max(-n, 0) :][: x.size]


def _fast_clock(share: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.interp(np.arange(x.size) / (1 + share), np.arange(x.size), x)


def _smoothed(x: np.ndarray, corner_hz: float = LOW_PASS_HZ) -> np.ndarray:
    return np.asarray(sosfiltfilt(butter(2, corner_hz, fs=RATE_HZ, output="sos"), x))


def _causally_smoothed(x: np.ndarray, corner_hz: float = LOW_PASS_HZ, order: int = 2) -> np.ndarray:
    b, a = butter(order, corner_hz, fs=RATE_HZ)
    return np.asarray(lfilter(b, a, x - x[0]) + x[0])


def _stimulus(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Trial], Trial]:
    """Apply a function of (n,) samples to the stimulus."""
    return lambda t: replace(t, stimulus=change(t.stimulus))


def _linear(matrix: tuple[tuple[float, float], tuple[float, float]]) -> Callable[[Trial], Trial]:
    return lambda t: replace(t, theta=t.theta @ np.array(matrix).T)


def _noise_only(it: Sound) -> Recording:
    """The stimulus of the recording beside the sway of the same person without one."""
    pairs = zip(it.recording.trials, it.still().trials, strict=True)
    return replace(it.recording, trials=tuple(replace(t, theta=still.theta) for t, still in pairs))


def _exchanged_segments(it: Sound) -> Recording:
    names = {"m1": "m2", "h1": "h2", "I1": "I2", "m2": "m1", "h2": "h1", "I2": "I1"}
    return replace(it.recording, body=Body.from_segments(**{names.get(k, k): v for k, v in it.segments.items()}))


def _all() -> tuple[Mislabelling, ...]:
    out = []

    def add(name: str, change: Callable[[Trial], Trial], *codes: str, only: int | None = None) -> None:
        out.append(Mislabelling(name, _trials(change, only), codes))

    factors = ((9.81, "9.81"), (180 / np.pi, "57.3"), (1000.0, "1000"), (2.0, "2"))
    both = {
        "9.81": ("kilogram_force", "newton"),
        "57.3": ("degrees", "radians"),
        "1000": ("thousand", "thousandth"),
        "2": ("double", "half"),
    }
    for factor, text in factors[1:3]:
        larger, smaller = both[text]
        add(f"both angles x {text}", _scaled(theta1=factor, theta2=factor), larger, "theta1: sways")
        add(f"both angles / {text}", _scaled(theta1=1 / factor, theta2=1 / factor), smaller)
    # A derivative of the stimulus makes the responses integrals.
    add("derivative of the stimulus", _stimulus(_derivative), "integral")
    add("integral of the stimulus", _stimulus(_integral), "velocity")
    for factor, text in factors:
        larger, smaller = both[text]
        # A stimulus that is recorded too large makes the responses too small.
        add(f"stimulus / {text}", _scaled(1 / factor), larger)
        add(f"stimulus x {text}", _scaled(factor), smaller, "stimulus: reaches")
        larger, smaller = ("times_g", "over_g") if text == "9.81" else both[text]
        for angle in ("theta1", "theta2"):
            add(f"{angle} x {text}", _scaled(**{angle: factor}), f"{larger}_{angle}", f"{angle}: sways")
            add(f"{angle} / {text}", _scaled(**{angle: 1 / factor}), f"{smaller}_{angle}")
    for which, text, ending in (((0, 1), "both angles", ""), ((0,), "theta1", "_theta1"), ((1,), "theta2", "_theta2")):
        add(f"derivative of {text}", _channels(which, _derivative), f"velocity{ending}")
        add(f"integral of {text}", _channels(which, _integral), f"integral{ending}")
        add(f"{text} low-passed at 3 Hz, zero phase", _channels(which, _smoothed), f"smoothed{ending}")
        add(f"{text} low-passed at 3 Hz, causal", _channels(which, _causally_smoothed), *_filtered(ending))
        for seconds, how in ((0.02, "20 ms late"), (0.05, "50 ms late"), (-0.05, "50 ms early")):
            code = (f"shifted{ending}",) if ending else ("shifted", "stimulus_delay")
            add(f"{text} {how}", _channels(which, _late(seconds)), *code)
    add("both angles low-passed at 6 Hz, zero phase", _channels((0, 1), partial(_smoothed, corner_hz=6.0)), "smoothed")
    fourth = partial(_causally_smoothed, corner_hz=5.0, order=4)
    add("theta2 low-passed at 5 Hz, fourth order, causal", _channels((1,), fourth), *_filtered("_theta2"))
    out += _of_one_trial()
    add("angles exchanged", _linear(((0, 1), (1, 0))), "swapped")
    add("both angles mirrored", _scaled(theta1=-1, theta2=-1), "sign")
    add("theta1 mirrored", _scaled(theta1=-1), "sign_theta1")
    add("theta2 mirrored", _scaled(theta2=-1), "sign_theta2")
    add("theta2 in space", _linear(((1, 0), (1, 1))), "space_angle")
    add("theta1 in the frame of the trunk", _linear(((1, 1), (0, 1))), "trunk_frame")
    add("clock of the angles 1 % fast", _channels((0, 1), _fast_clock(0.01)), "clock is")
    add("clock of the angles 1 % slow", _channels((0, 1), _fast_clock(-0.01)), "clock is")
    add("clock of the angles 0.3 % fast", _channels((0, 1), _fast_clock(0.003)), "clock is")
    add("clock of the second trial's angles 1 % fast", _channels((0, 1), _fast_clock(0.01)), "clock is", only=1)
    out.append(Mislabelling("noise without a response", _noise_only, ("no response",)))
    out.append(Mislabelling("segments exchanged in the body file", _exchanged_segments, ("segments",)))
    return tuple(out)


def _filtered(ending: str) -> tuple[str, ...]:
    """Codes of a low-pass with delay. A Butterworth filter is a form of the effect of a lag, too."""
    return f"filtered{ending}", {"": "stimulus_lag"}.get(ending, f"sensor_lag{ending}")


def _of_one_trial() -> list[Mislabelling]:
    """Mistakes in one of two trials. Where a trial has too small a factor, the other has too large a one."""
    out = []

    def add(name: str, change: Callable[[Trial], Trial], *codes: str, only: int = 1) -> None:
        which = ("first", "second")[only]
        out.append(Mislabelling(f"{which} trial's {name}", _trials(change, only), codes))

    add("angles 50 ms late", _channels((0, 1), _late(0.05)), "shifted_trial_2")
    add("angles 50 ms early", _channels((0, 1), _late(-0.05)), "shifted_trial_1", only=0)
    add("theta1 50 ms late", _channels((0,), _late(0.05)), "shifted_theta1_trial_2")
    add("theta2 20 ms early", _channels((1,), _late(-0.02)), "shifted_theta2_trial_2")
    add("stimulus x 2", _scaled(2.0), "half_trial_2", "double_trial_1")
    add("stimulus / 2", _scaled(0.5), "double_trial_2", "half_trial_1")
    add("stimulus x 2", _scaled(2.0), "half_trial_1", "double_trial_2", only=0)
    newton = "trial 2: stimulus: seems to be in N m but declared kgf m"
    add("stimulus x 9.81", _scaled(9.81), newton, "newton_trial_2", "kilogram_force_trial_1")
    kgf = "trial 2: stimulus: seems to be in kgf m but declared N m"
    add("stimulus / 9.81", _scaled(1 / 9.81), kgf, "kilogram_force_trial_2", "newton_trial_1")
    deg, rad = 180 / np.pi, np.pi / 180
    in_deg = "seems to be in deg but declared rad"
    add("angles x 57.3", _scaled(1, deg, deg), f"trial 2: theta1, theta2: {in_deg}", "trial 2: theta1: sways")
    add("angles / 57.3", _scaled(1, rad, rad), "trial 2: theta1, theta2: seems to be in rad but declared deg")
    add("theta1 x 57.3", _scaled(theta1=deg), f"trial 2: theta1: {in_deg}", "trial 2: theta1: sways")
    add("theta2 x 57.3", _scaled(theta2=deg), f"trial 2: theta2: {in_deg}", "trial 2: theta2: sways")
    add("theta1 / 2", _scaled(theta1=0.5), "half_theta1_trial_2", "double_theta1_trial_1")
    add("theta2 x 2", _scaled(theta2=2.0), "double_theta2_trial_2", "half_theta2_trial_1")
    exchanged = "theta1, theta2: seems to be exchanged"
    add("angles exchanged", _linear(((0, 1), (1, 0))), "swapped_trial_2", f"trial 2: {exchanged}")
    add("angles exchanged", _linear(((0, 1), (1, 0))), "swapped_trial_1", f"trial 1: {exchanged}", only=0)
    opposite = "trial 2: stimulus or theta1, theta2: seems to be of opposite sign"
    add("angles mirrored", _scaled(theta1=-1, theta2=-1), "sign_trial_2", opposite)
    for k, name in enumerate(("theta1", "theta2")):
        mirrored = _scaled(**{name: -1.0})
        add(f"{name} mirrored", mirrored, f"sign_{name}_trial_2", f"trial 2: {name}: seems to be of the wrong sign")
        velocity = f"trial 2: {name}: seems to be an angular velocity"
        add(f"{name} its derivative", _channels((k,), _derivative), velocity)
    space = "trial 2: theta2: seems to be the angle of the upper body in space"
    add("theta2 in space", _linear(((1, 0), (1, 1))), "space_angle_trial_2", space)
    add("angles low-passed at 3 Hz, causal", _channels((0, 1), _causally_smoothed), "filtered_trial_2")
    add("angles low-passed at 3 Hz, zero phase", _channels((0, 1), _smoothed), "smoothed_trial_2")
    return out


MISLABELLINGS = _all()
"""All ways to mislabel a recording."""
