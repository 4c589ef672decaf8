"""The nearest mechanism of the library, whatever the verdict: how well it resembles the gap, and what it leaves.

The nearest mechanism is the most probable named cause that changes the mean response of the body. What it leaves is
described twice: as the bands in which its residual is larger than noise, and as a torque with a rational transfer
function (`mcstudy.gap.questions.remaining_torque`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.closure import smooth_directions
from mcstudy.gap.questions.detection import Band, Detection, bands, linear_null, standardised
from mcstudy.gap.questions.evidence import Hypothesis, possible
from mcstudy.gap.questions.likeness import likeness
from mcstudy.gap.questions.posterior import Cause
from mcstudy.gap.questions.remaining_torque import RemainingTorque, remaining_torque
from mcstudy.spectra.lines import Lines
from mcstudy.stance.joint import members
from mcstudy.streams import stream

DRAWS = 300
"""Null samples of the bands."""

SHOWN = 1e-4
"""Probability from which the likeness of a cause is computed, besides that of the nearest one."""


@dataclass(frozen=True)
class Nearest:
    """The nearest mechanism.

    Attributes
    ----------
    cause
        The mechanism (`Cause`), with its probability and likeness.
    chi2
        Squared residual of all lines with it.
    bands
        Mean squared standardised residual by angle and band with it (`Band`).
    remaining
        The torque that it leaves unexplained (`RemainingTorque`).
    """

    cause: Cause
    chi2: float
    bands: tuple[Band, ...] = field(repr=False)
    remaining: RemainingTorque

    def of_part(self, k: int, some: slice) -> Nearest:
        """As seen in one recording of a joint set: the responses to its stimulus, at its lines."""
        fitted = replace(self.cause.fitted, model=members(self.cause.fitted.model)[k])
        return replace(self, cause=replace(self.cause, fitted=fitted), remaining=self.remaining.of_lines(some))

    @property
    def effects(self) -> tuple[str, ...]:
        """Name of the effect, or of the two."""
        return self.cause.effects


def with_likeness(
    base: Fitted, causes: Sequence[Cause], data: Data, space: np.ndarray, detection: Detection, seed: int
) -> tuple[Cause, ...]:
    """The causes, those that are shown with their likeness; ``space`` (4 N, M) spans the smooth deviations.

    Weak priors hold the base model back, so a part of the gap lies along its parameters; these directions count too.
    """
    first = _first(base, causes)
    along = np.linalg.qr(base.jacobian(data) * base.prior.scale)[0]
    directions = np.concatenate([along, smooth_directions(base, data, space)], axis=1)
    chosen = [k for k, c in enumerate(causes) if c.mechanism(base) and (c.probability > SHOWN or c is first)]
    intervals = likeness(
        base,
        [causes[k].fitted for k in chosen],
        data,
        directions,
        detection.unstructured.scale,
        stream(seed, "gap likeness"),
    )
    out = list(causes)
    for k, interval in zip(chosen, intervals, strict=True):
        out[k] = replace(out[k], likeness=interval)
    return tuple(out)


def nearest(base: Fitted, causes: Sequence[Cause], data: Data, lines: Lines, seed: int) -> Nearest | None:
    """The nearest mechanism among causes in order of decreasing probability.

    None when the causes hold no mechanism of a size that a body can have.
    """
    cause = _first(base, causes)
    if cause is None:
        return None
    fitted = cause.fitted
    null = linear_null(fitted, data, lines.noise.draw(stream(seed, "gap nearest null"), DRAWS))
    z = standardised(fitted, data, fitted.residual(data)[:, None])[..., 0]
    where = bands(data.f, base.model, z, standardised(fitted, data, null))
    power = lines.power / len(lines.parts)  # the torque is that of an average recording
    left = remaining_torque(fitted, data, power, stream(seed, "gap remaining torque"))
    return Nearest(cause, fitted.chi2, where, left)


def _first(base: Fitted, causes: Sequence[Cause]) -> Cause | None:
    """The first mechanism of a size that a body can have."""
    return next(
        (c for c in causes if c.mechanism(base) and possible(Hypothesis(c.effects, 0.0, c.fitted, c.sizes), base)), None
    )
