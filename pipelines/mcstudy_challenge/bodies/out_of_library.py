"""Out-of-library effects, for the challenge only; no module that answers may import this one.

Some are table terms that the library lacks, some are torques that depend on the history of the sway, and some distort
the recorded angles. Their sizes change a response visibly; none is a published value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, signal
from scipy.interpolate import CubicSpline

from mcstudy.compiling.decorators import compiled
from mcstudy.effect_library.protocol import Distortion, Protocol, Torque, simulate_recording
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.simulate_time import Sway

ANKLE = 1


@dataclass(frozen=True)
class OutOfLibraryEffect:
    """One out-of-library effect.

    Attributes
    ----------
    name, equation: for the key. place: its location. size: range (low, high) of the magnitude. unit: of the size.
    model: adds table terms for a size; torque: makes a sway-dependent torque; measure: distorts the recorded angles.
    bends: whether it depends on the sway in more than proportion, so that the noise of the senses changes it.
    """

    name: str
    equation: str
    place: tuple[str, ...]
    size: tuple[float, float]
    unit: str
    model: Callable[[Model, float], Model] | None = None
    torque: Callable[[float], Torque] | None = None
    measure: Callable[[float], Distortion] | None = None
    bends: bool = False


def constant(name: str, value: float) -> Parameter:
    """A parameter that is a constant of the simulation."""
    width = max(abs(value), 1e-6)
    return Parameter(name, "", value, value - width, value + width)


def holding(model: Model, theta: np.ndarray) -> Model:
    """The model with nominal values ``theta`` (P,) and bounds that include them."""
    return model.with_bounds(
        {p.name: (min(p.lower, v), max(p.upper, v)) for p, v in zip(model.parameters, theta, strict=True)}
    ).with_values(dict(zip(model.names, map(float, theta), strict=True)))


def _on_ankle(values: np.ndarray) -> np.ndarray:
    return np.column_stack([np.zeros_like(values), values])


def _on_hip(values: np.ndarray) -> np.ndarray:
    return np.column_stack([values, np.zeros_like(values)])


@compiled
def _play(x: np.ndarray, width: float) -> np.ndarray:
    """Play (backlash) operator: follows the input only when it leaves a band of +- width."""
    out, y = np.empty_like(x), 0.0
    for i in range(x.size):
        y = min(max(y, x[i] - width), x[i] + width)
        out[i] = y
    return out


def _hysteresis(size: float) -> Torque:
    """Ankle friction: part of the stiffness acts through a play of 0.15 deg."""
    return lambda sway, _: _on_ankle(-size * (sway.angle[:, 0] - _play(sway.angle[:, 0], np.deg2rad(0.15))))


def _quadratic_damping(size: float) -> Torque:
    return lambda sway, _: _on_hip(-size * np.abs(sway.rate[:, 1]) * sway.rate[:, 1])


def _wandering_clock(size: float) -> Distortion:
    """The clock of the angles deviates by size * sin(2 pi t / 37 s) from the clock of the stimulus."""

    def measure(theta: np.ndarray, rate: float) -> np.ndarray:
        t = np.arange(theta.shape[0]) / rate
        warped = t + size * np.sin(2 * np.pi * t / 37.0)
        return CubicSpline(t, theta)(np.clip(warped, 0, t[-1]))

    return measure


def _series_compliance(size: float) -> Torque:
    """A tendon that stiffens with load takes up part of the active ankle torque: T -> T (1 - size / (1 + |T| / 5 N m)),
    the missing part smoothed over 60 ms."""

    def torque(sway: Sway, rate: float) -> np.ndarray:
        active = sway.active_torque[:, ANKLE]
        lost = size * active / (1 + np.abs(active) / 5.0)
        a = np.exp(-1 / (0.06 * rate))
        return _on_ankle(signal.lfilter([1 - a], [1, -a], lost))

    return torque


def _fractional_stiffness(size: float) -> Torque:
    """Hip viscoelasticity of order one half: torque -size D^0.5 theta2, the record at rest before time 0."""

    def torque(sway: Sway, rate: float) -> np.ndarray:
        n = sway.angle.shape[0]
        spectrum = fft.rfft(sway.angle[:, 1], 2 * n)
        s = 2j * np.pi * np.arange(spectrum.size) * rate / (2 * n)
        half = np.sqrt(s) / (1 + s / (2 * np.pi * 20.0))
        return _on_hip(-size * fft.irfft(spectrum * half, 2 * n)[:n])

    return torque


def _leg_mass(model: Model, size: float) -> Model:
    """Soft tissue of ``size`` kg, 0.5 m up the leg, on a spring of 3 Hz with damping ratio 0.15 instead of rigid."""
    w, height = 2 * np.pi * 3.0, 0.5
    filt = Filter(
        "wobble",
        (Monomial(-1.0, 2),),
        (Monomial(1.0, 2), Monomial(2 * 0.15 * w, 1), Monomial(w**2, 0)),
    )
    return model.with_terms(
        [constant("m_wobble", size)],
        [Term("ankle", "theta1", ("m_wobble",), 2, filters=("wobble",), coefficient=height**2)],
        [filt],
    )


def _split_delay(model: Model, size: float) -> Model:
    """Cross-coupling feedback (K12, K21 and their damping) arrives ``size`` s later than the direct one."""
    by_row = {t.row: t.delay for t in model.terms if t.noisy}
    values = {p.name: p.value for p in model.parameters}
    late = {row: constant(f"late_{row}", values[str(delay)] + size) for row, delay in by_row.items()}
    crossed = {("hip", "theta1"), ("ankle", "theta2")}
    terms = tuple(
        replace(t, delay=f"late_{t.row}") if t.noisy and (t.row, t.sense) in crossed else t for t in model.terms
    )
    return replace(model, parameters=(*model.parameters, *late.values()), terms=terms)


def _washout(model: Model, size: float) -> Model:
    """Active feedback of the lower body is partly high-passed: factor (s + 0.6 a) / (s + a), a = ``size`` 1/s."""
    filt = Filter("washout", (Monomial(1.0, 1), Monomial(0.6 * size, 0)), (Monomial(1.0, 1), Monomial(size, 0)))
    terms = tuple(
        replace(t, filters=(*t.filters, "washout")) if t.noisy and t.sense == "theta1" else t for t in model.terms
    )
    return replace(model, terms=terms, filters=(*model.filters, filt))


def _crosstalk(size: float) -> Distortion:
    """The hip sensor picks up a share of the lower body's angle, and the lower body's sensor of the hip's."""
    return lambda theta, _: theta @ np.array([[1.0, size], [-size / 2, 1.0]])


def _lumbar(model: Model, size: float) -> Model:
    """Hip stiffness through a flexible lumbar joint: -size (s / (s + 5 1/s)) theta2, a relaxing passive stiffness."""
    filt = Filter("lumbar", (Monomial(1.0, 1),), (Monomial(1.0, 1), Monomial(5.0, 0)))
    return model.with_terms(
        [constant("k_lumbar", size)], [Term("hip", "theta2", ("k_lumbar",), filters=("lumbar",))], [filt]
    )


OUT_OF_LIBRARY: dict[str, OutOfLibraryEffect] = {
    o.name: o
    for o in (
        OutOfLibraryEffect(
            "hysteresis",
            "ankle: stiffness through a play",
            ("ankle",),
            (60, 180),
            "N m/rad",
            torque=_hysteresis,
            bends=True,
        ),
        OutOfLibraryEffect(
            "quadratic_damping",
            "hip: -c |rate| rate",
            ("hip",),
            (40, 140),
            "N m s^2/rad^2",
            torque=_quadratic_damping,
            bends=True,
        ),
        OutOfLibraryEffect(
            "wandering_clock", "angles early or late", ("sensor",), (0.02, 0.06), "s", measure=_wandering_clock
        ),
        OutOfLibraryEffect(
            "series_compliance",
            "ankle torque lost",
            ("ankle",),
            (0.1, 0.25),
            "",
            torque=_series_compliance,
            bends=True,
        ),
        OutOfLibraryEffect(
            "fractional_stiffness",
            "hip: D^0.5 theta2",
            ("hip",),
            (3, 12),
            "N m s^0.5/rad",
            torque=_fractional_stiffness,
        ),
        OutOfLibraryEffect("leg_wobble", "leg mass on a spring", ("body",), (4, 12), "kg", model=_leg_mass),
        OutOfLibraryEffect(
            "split_delay", "cross feedback later", ("ankle", "hip"), (0.004, 0.012), "s", model=_split_delay
        ),
        OutOfLibraryEffect(
            "washout", "theta1 feedback high-passed", ("ankle", "hip"), (0.2, 0.8), "1/s", model=_washout
        ),
        OutOfLibraryEffect(
            "lumbar_relaxation", "hip: relaxing stiffness", ("hip",), (20, 80), "N m/rad", model=_lumbar
        ),
        OutOfLibraryEffect(
            "sensor_crosstalk", "sensors mix the angles", ("sensor",), (0.05, 0.20), "", measure=_crosstalk
        ),
    )
}
"""All of them by name."""


def simulate_out_of_library(
    name: str,
    size: float,
    protocol: Protocol,
    theta: np.ndarray,
    rng: np.random.Generator,
    body: Body | None = None,
) -> Recording:
    """A recording with one out-of-library effect on the two-segment model with parameters ``theta`` (12,).

    Raises `InputError` when the body is unstable with it or the iteration does not converge.
    """
    o = OUT_OF_LIBRARY[name]
    model = two_segment(body, protocol.stimulus)
    theta = np.asarray(theta, dtype=float)
    if o.model is not None:
        model = o.model(holding(model, theta), size)
        theta = model.truth
    return simulate_recording(
        protocol,
        theta,
        rng,
        model=model,
        body=body,
        torque=None if o.torque is None else o.torque(size),
        measure=None if o.measure is None else o.measure(size),
    )
