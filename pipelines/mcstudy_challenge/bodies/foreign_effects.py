"""Mechanisms of foreign bodies: thirteen that the library knows in roughly this form, and seven that it does not.

Each is written as physiology or mechanics has it, as a change of the constants of
`mcstudy_challenge.bodies.foreign_body`, not as a change of the library's equations. As there, nothing of the models and
effects of a diagnosis is imported; the library's names are mere words here. Sizes change a response visibly; only those
of the threshold are published ones (0.05 to 0.2 deg).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from mcstudy_challenge.bodies.foreign_body import Person

GRAVITY = 9.81

Shapes = Mapping[str, float]

Change = Callable[[Person, float, Shapes], Person]
"""(person, size, shape constants) -> the person with the mechanism."""


@dataclass(frozen=True)
class ForeignEffect:
    """One mechanism.

    Attributes
    ----------
    name, words: for the key and the reader. mechanism: name of the library's effect that it is a form of; empty for
        a cause outside the library. start, top: first and largest magnitude of the size in ``unit``. shapes: range of
        every shape constant, drawn uniformly on a log scale. change: makes the person with the mechanism; None: the
        recorded angles are those of a camera whose filter has this size (`recorded`). both: whether both signs occur.
        lasting: whether it is the same in every cycle. contrast: whether it shows only where trials have different
        amplitudes. bends: whether noise of the senses changes its mean response, because it depends on the sway in more
        than proportion, or whether it changes that noise itself.
    """

    name: str
    words: str
    mechanism: str
    start: float
    top: float
    unit: str
    change: Change | None
    shapes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    both: bool = False
    lasting: bool = True
    contrast: bool = False
    bends: bool = False

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Random shape constants."""
        return {k: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for k, (low, high) in self.shapes.items()}


def recorded(angles: np.ndarray, rate_hz: float, lag_s: float) -> np.ndarray:
    """Angles (n, 2) behind the filter of a camera: Butterworth of 2nd order that delays slow signals by ``lag_s``.

    The lag may be far shorter than a sample. The filter works on a period, so the record is led back from its end to
    its start without a jump or a kink: a jump would ring at half the sampling rate through the last cycle.
    """
    n = len(angles)
    back = 20 + int(np.ceil(20 * lag_s * rate_hz))
    first, last = angles[1] - angles[0], angles[-1] - angles[-2]
    x = (np.arange(1, back + 1) / (back + 1))[:, None]
    values = angles[-1] * (1 + 2 * x) * (1 - x) ** 2 + angles[0] * x**2 * (3 - 2 * x)
    slopes = (back + 1) * (last * x * (1 - x) ** 2 - first * x**2 * (1 - x))
    period = np.concatenate([angles, values + slopes])
    s = 2j * np.pi * np.fft.rfftfreq(len(period), 1 / rate_hz) * lag_s
    return np.fft.irfft(np.fft.rfft(period, axis=0) / (1 + s + s**2 / 2)[:, None], len(period), axis=0)[:n]


def _leg_length(p: Person) -> float:
    """From ankle to hip, m: the inertia by which legs and trunk are coupled is W2 / g times it."""
    return p.M12 * GRAVITY / p.W2


def _hinged(p: Person, mass: float, joint: float, length: float, resonance_hz: float, damping: float) -> Person:
    """A part of the trunk's mass, ``length`` above (hanging: below, negative) a joint at height ``joint`` over the hip,
    free to turn there: a third segment. The upright person as a whole keeps inertia and weight."""
    leg, height = _leg_length(p), joint + length
    inertia, weight = mass * length**2, mass * GRAVITY * length
    omega = 2 * np.pi * resonance_hz
    stiffness = inertia * omega**2 + weight
    return p._replace(
        M12=p.M12 - mass * leg * length,
        M22=p.M22 - mass * height**2 + mass * joint**2,
        W2=p.W2 - weight,
        M13=mass * leg * length,
        M23=mass * joint * length,
        M33=inertia,
        W3=weight,
        joint_k=stiffness,
        joint_c=2 * damping * omega * inertia,
    )


def _neck(p: Person, size: float, shape: Shapes) -> Person:
    return _hinged(p, size, 0.50, 0.15, shape["resonance"], shape["damping"])


def _arms(p: Person, size: float, shape: Shapes) -> Person:
    """Arms that hang from the shoulders, 0.45 m over the hip, with their mass 0.3 m below, on little stiffness."""
    return _hinged(p, size, 0.45, -0.30, shape["resonance"], shape["damping"])


def _rucksack(p: Person, size: float, shape: Shapes) -> Person:
    leg, height = _leg_length(p), shape["height"]
    return p._replace(
        M11=p.M11 + size * leg**2,
        M12=p.M12 + size * leg * height,
        M22=p.M22 + size * height**2,
        W1=p.W1 + size * GRAVITY * leg,
        W2=p.W2 + size * GRAVITY * height,
    )


_MECHANISMS = (
    ForeignEffect(
        "muscle", "active torque through two lags, the first slower while the torque falls", "activation_dynamics",
        0.004, 0.15, "s",
        lambda p, a, s: p._replace(rise=a, fall=a * s["fall"]),
        {"fall": (1.0, 2.5)}, bends=True,
    ),
    ForeignEffect(
        "neck", "the head turns on a neck, as a third segment of the chain", "loose_head",
        2.0, 9.0, "kg", _neck, {"resonance": (1.5, 4.0), "damping": (0.08, 0.4)},
    ),
    ForeignEffect(
        "soft_ankle", "passive damping of the ankle that falls with speed", "passive_damping_ankle",
        15.0, 140.0, "N m s/rad",
        lambda p, a, s: p._replace(tissue_ankle=a, tissue_rate=s["rate"]),
        {"rate": (0.01, 0.1)}, bends=True,
    ),
    ForeignEffect(
        "soft_hip", "passive damping of the hip that falls with speed", "passive_damping_hip",
        3.0, 40.0, "N m s/rad",
        lambda p, a, s: p._replace(tissue_hip=a, tissue_rate=s["rate"]),
        {"rate": (0.01, 0.1)}, bends=True,
    ),
    ForeignEffect(
        "calf_reflex", "stretch reflex of the ankle that is weaker for shortening", "short_latency_reflex",
        20.0, 140.0, "N m s/rad",
        lambda p, a, s: p._replace(
            reflex_gain=a, reflex_delay=s["delay"], reflex_share=s["share"], reflex_lag=s["lag"]
        ),
        {"delay": (0.04, 0.06), "share": (0.3, 0.8), "lag": (0.005, 0.02)}, bends=True,
    ),
    ForeignEffect(
        "strap", "a passive muscle over both joints, with unequal levers", "biarticular_coupling",
        30.0, 200.0, "N m/rad",
        lambda p, a, s: p._replace(strap=a, strap_arm=s["arm"]),
        {"arm": (0.6, 1.6)},
    ),
    ForeignEffect(
        "load_receptors", "positive feedback of the ankle's torque that saturates", "force_feedback",
        0.6, 2.2, "",
        lambda p, a, s: p._replace(load_gain=a, load_time=s["time"], load_limit=s["limit"]),
        {"time": (10.0, 25.0), "limit": (4.0, 20.0)}, bends=True,
    ),
    ForeignEffect(
        "slow_bias", "feedback of the ankle's integral, which is forgotten", "integral_ankle",
        40.0, 250.0, "N m/(rad s)",
        lambda p, a, s: p._replace(bias_gain=a, bias_leak=s["leak"]),
        {"leak": (0.02, 0.25)},
    ),
    ForeignEffect(
        "servo", "the motor of the stimulus is of second order", "stimulus_lag",
        0.01, 0.1, "s",
        lambda p, a, s: p._replace(motor=2 * s["damping"] / a, motor_damping=s["damping"]),
        {"damping": (0.6, 1.2)},
    ),
    ForeignEffect(
        "camera", "both recorded angles behind a filter of second order", "sensor_lag_both",
        0.01, 0.1, "s", None,
    ),
    ForeignEffect(
        "soft_threshold", "small angles and rates are sensed weakly", "dead_zone",
        0.001, 0.0035, "rad",
        lambda p, a, s: p._replace(blind_angle=a, blind_rate=a * s["rate"]),
        {"rate": (2.0, 6.0)}, contrast=True, bends=True,
    ),
    ForeignEffect(
        "fatigue", "active torque changes over the record, first fast, then slowly", "gain_drift",
        0.05, 0.5, "", lambda p, a, _: p._replace(fatigue=a), both=True, lasting=False,
    ),
    ForeignEffect(
        "rucksack", "a load on the trunk that the body file does not know", "trunk_inertia_error",
        2.0, 20.0, "kg", _rucksack, {"height": (0.2, 0.5)},
    ),
)  # fmt: skip

_OUTSIDE = (
    ForeignEffect(
        "ankle_friction", "dry friction of the ankle", "",
        0.3, 5.0, "N m", lambda p, a, _: p._replace(friction=a, friction_rate=0.003), bends=True,
    ),
    ForeignEffect(
        "arms", "the arms swing from the shoulders", "",
        2.0, 10.0, "kg", _arms, {"resonance": (0.6, 1.0), "damping": (0.05, 0.2)},
    ),
    ForeignEffect(
        "foot_pad", "the foot stands on a soft pad", "",
        0.0005, 0.01, "rad/(N m)",
        lambda p, a, s: p._replace(pad_k=1 / a, pad_c=s["time"] / a), {"time": (0.02, 0.5)},
    ),
    ForeignEffect(
        "hip_stiffening", "stiffness of the hip grows with its angle", "",
        1e4, 1e7, "N m/rad^3", lambda p, a, _: p._replace(stiffening=a), bends=True,
    ),
    ForeignEffect(
        "ringing_motor", "the motor of the stimulus resonates within the band", "",
        0.004, 0.2, "s",
        lambda p, a, s: p._replace(motor=1 / a, motor_damping=s["damping"]), {"damping": (0.1, 0.3)},
    ),
    ForeignEffect(
        "wandering_delay", "the ankle's delay changes slowly to and fro", "",
        0.01, 0.06, "s",
        lambda p, a, s: p._replace(delay_swing=a, delay_period=s["period"]), {"period": (5.0, 40.0)}, lasting=False,
    ),
    ForeignEffect(
        "held_command", "commands are renewed at intervals only", "",
        0.02, 0.3, "s", lambda p, a, _: p._replace(hold=a), bends=True,
    ),
)  # fmt: skip

FOREIGN: dict[str, ForeignEffect] = {e.name: e for e in (*_MECHANISMS, *_OUTSIDE)}
"""All of them by name."""
