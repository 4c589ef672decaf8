"""What would make the intervals narrower, predicted from the Fisher information at the estimate.

The profile gives the width of an interval as it is, the information the ratio by which a change of the experiment
scales it: twice the cycles multiply all information by two, twice the amplitude by four; lines at higher frequencies,
with their measured noise, add their own; a parameter that is known from elsewhere removes a row and a column, and
helps less than that where the likelihood is far from quadratic. Bounds are left out of the information. Where they end
an interval, or where profile and information disagree about the present width, a prediction to first order is rough,
and is marked so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mcstudy.identification.estimate import Estimate
from mcstudy.models.quantities import Quantity
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.information import line_information, standard_errors
from mcstudy.stance.joint import with_lines

AGREE = 1.5
"""Profile and information agree about a width if neither is larger than the other by this factor."""


@dataclass(frozen=True)
class Forecast:
    """Half-width of the interval of one quantity, now and after changes of the experiment, in its unit.

    Attributes
    ----------
    name
        The quantity.
    now
        Half of the present interval.
    cycles, amplitude
        With twice the cycles, and with twice the amplitude of the stimulus.
    fmax
        With the lines up to ``fmax_hz``; None where the recording has none.
    fmax_hz
        That frequency, Hz.
    known, with_known
        The parameter whose value, if it were known, would narrow the interval most, and the half-width then.
    rough
        Whether the prediction is rough, see the module.
    """

    name: str
    now: float
    cycles: float
    amplitude: float
    fmax: float | None
    fmax_hz: float | None
    known: str
    with_known: float
    rough: bool


def forecasts(
    model: Model,
    theta: np.ndarray,
    lines: Lines,
    wanted: Sequence[Quantity],
    estimates: Sequence[Estimate],
    level: float,
    higher: Lines | None = None,
) -> tuple[Forecast, ...]:
    """Forecasts for ``wanted`` quantities with their ``estimates``; ``higher``: lines up to a higher frequency."""
    information = fisher(model, theta, lines)
    gradients = np.array([q.gradient(theta) for q in wanted])
    now = standard_errors(information, gradients)
    more = None
    if higher is not None:  # what the lines of the fit hold stays as it is
        beyond = fisher(model, theta, higher) - fisher(model, theta, higher.below(float(lines.f.max()) * (1 + 1e-9)))
        more = standard_errors(information + beyond, gradients)
    known = np.array([standard_errors(information, gradients, k) for k in range(theta.size)])  # (P, K)
    itself = (gradients != 0).sum(axis=1) == 1
    known[np.abs(gradients.T) * itself > 0] = np.inf  # a parameter is not helped by knowing itself
    z = float(ndtri(0.5 + level / 2))
    out = []
    for k, e in enumerate(estimates):
        half = (e.high - e.low) / 2
        rough = e.verdict != "identifiable" or not 1 / AGREE <= half / (z * now[k]) <= AGREE
        width = z * now[k] if e.verdict != "identifiable" else half
        scale, best = width / now[k], int(known[:, k].argmin())
        out.append(
            Forecast(
                name=e.name,
                now=half,
                cycles=float(width / np.sqrt(2)),
                amplitude=float(width / 2),
                fmax=None if more is None else float(scale * more[k]),
                fmax_hz=None if higher is None else float(higher.f.max()),
                known=model.names[best],
                with_known=float(scale * known[best, k]),
                rough=bool(rough),
            )
        )
    return tuple(out)


def fisher(model: Model, theta: np.ndarray, lines: Lines) -> np.ndarray:
    """Fisher information (P, P) on the parameters of ``model`` at ``theta``."""
    stacked = with_lines(model, lines.counts)
    return np.asarray(line_information(stacked, theta, lines.f, lines.noise.whitener).sum(axis=0))
