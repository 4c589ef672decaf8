"""Nonlinear and time-varying rules of the time-domain simulator, which a term table cannot express.

Each field at its default leaves the loop linear. The rules act on signals and torques of the model's own table; no
equation is written here. Derived.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import Model, Term


@dataclass(frozen=True, eq=False)
class Rules:
    """Rules for one simulation.

    Attributes
    ----------
    dead_angle: thresholds on the R sensed joint angles (with their noise), rad; empty for none. Active feedback of an
        angle x reads 0 inside +-threshold and x -+ threshold outside (continuous). With a tilt u and its weight W, what
        is sensed of the lowest angle is the weighted sum of the senses, theta1 - W u + noise.
    dead_rate: the same on the sensed rates, rad/s, for active feedback of order 1.
    torque_limit: largest active torque of each of the R rows, N m, at +- which it is cut; empty for none.
    motor_noise: additional torque per row, N m, (n, R) samples, linear between samples; None for none. White noise
        of one-sided density S is samples of variance S * rate / 2; the interpolation loses 1 % of power at 0.08 of
        the rate.
    active_gain: factor on every active term (see `reweighted`).
    gain_drift: per gain parameter, the relative change d over the record: the terms it multiplies are multiplied
        with 1 + d (t / duration - 1/2).
    """

    dead_angle: tuple[float, ...] = ()
    dead_rate: tuple[float, ...] = ()
    torque_limit: tuple[float, ...] = ()
    motor_noise: np.ndarray | None = None
    active_gain: float = 1.0
    gain_drift: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("dead_angle", "dead_rate", "torque_limit"):
            values = getattr(self, name)
            if not all(value >= 0 for value in values):
                raise ModelError(f"rules {name}: expected numbers >= 0, got {values!r}")
        if not (np.isfinite(self.active_gain) and self.active_gain >= 0):
            raise ModelError(f"rules active_gain: expected a number >= 0, got {self.active_gain!r}")
        for name, drift in self.gain_drift.items():
            if not np.isfinite(drift):
                raise ModelError(f"rules gain_drift {name}: expected a finite number, got {drift!r}")


LINEAR = Rules()
"""No rule at all."""


def reweighted(amplitude: float, reference: float, exponent: float) -> float:
    """Active gain at a stimulus amplitude: (amplitude / reference)**-exponent.

    1 at the reference amplitude, smaller above it for a positive exponent: sensory reweighting (Peterka 2002 reports
    weights 0.8 to 0.4 over 0.5 to 4 deg, an exponent of 1/3).
    """
    if not (amplitude > 0 and reference > 0):
        raise ModelError(f"reweighting: amplitudes must be positive, got {amplitude!r} and {reference!r}")
    try:
        gain = float((amplitude / reference) ** -exponent)
    except OverflowError:
        gain = np.inf
    if not np.isfinite(gain):
        raise ModelError(f"reweighting: expected an exponent that gives a finite gain, got {exponent!r}")
    return gain


def tilt_at_threshold(model: Model, rules: Rules) -> np.ndarray:
    """Entries (E,) of the table by which active feedback senses a tilt on which a threshold acts; none without one.

    The threshold acts on the weighted sum of the senses, theta1 - W u plus noise (derived: one central threshold, not
    one for each sense).

    Raises `ModelError` where the active feedback of theta1 does not all sense that sum.
    """
    entries = np.zeros(len(model.table.entry), dtype=bool)
    if not (model.weights and any((*rules.dead_angle, *rules.dead_rate))):
        return entries
    weight = model.weights[0]

    def path(term: Term, gain: tuple[str, ...]) -> tuple[object, ...]:
        return term.row, gain, term.order, term.all_delays, term.filters, term.coefficient

    active = [(k, term) for k, term in enumerate(model.terms) if term.noisy]
    tilt = {path(t, t.gain[:1]) for _, t in active if t.sense == "stimulus" and t.gain[1:] == (weight,)}
    legs = {path(t, t.gain) for _, t in active if t.sense in ("theta1", "theta2s")}
    entries[[k for k, term in active if term.sense == "stimulus"]] = True
    if tilt != legs or len(tilt) != entries.sum() or weight in rules.gain_drift:
        raise ModelError(
            f"rules dead_angle: model {model.name}: a threshold with a tilt needs all active feedback of theta1 to "
            f"sense the tilt with the weight {weight}, and nothing else to sense it"
        )
    return entries
