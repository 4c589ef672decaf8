"""What is said about a fit beyond its estimates: each part is a module of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from mcstudy.errors import RecordingError
from mcstudy.identification.belief import gap_found, with_effects
from mcstudy.identification.forecast import forecasts
from mcstudy.identification.loop_stability import stability
from mcstudy.identification.paper_cost import paper_estimate
from mcstudy.identification.quantities import quantities
from mcstudy.identification.result import FitResult
from mcstudy.identification.simulated_coverage import nearest
from mcstudy.identification.sway import predicted_sway
from mcstudy.identification.trades import bodies, valleys
from mcstudy.lines.checked_recording import Discard, discarded
from mcstudy.recordings.joint import AnyRecording, JointRecording
from mcstudy.spectra.joint_lines import joined
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import measure, require_noise
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate

HIGHER_HZ = (1.2, 3.1, 8.0)
"""Frequencies up to which lines are added in a forecast: the next one above the fit's."""

CLEARLY = 1.2
"""Factor by which it exceeds that of the fit."""


def complete(
    fitted: FitResult,
    recording: AnyRecording,
    nominal: Model,
    base: Model,
    wanted: Sequence[str] | Mapping[str, Any],
) -> FitResult:
    """The fit of a recording with everything that is said about it.

    ``nominal``: the model without effects, as it was given. ``base``: the same with the bounds of the fit. ``wanted``:
    the quantities that were asked for.
    """
    f, seed, discard = fitted, int(fitted.method["seed"]), fitted.method["discard"]
    gap, test = gap_found(f.lines, nominal, seed)
    added = f.method["effects"]
    comparison = None
    if added and f.without is not None:
        comparison = with_effects(test, f.lines, (base, f.model), (f.without, f.minima), added)
    everybody = bodies(f.estimates)
    standing = everybody[growth_rate(f.model, everybody) < 0]
    return replace(
        f,
        valleys=valleys(f.model, base, f.lines, f.minima, f.estimates, f.level, seed),
        stability=stability(f.model, f.theta, f.estimates),
        sway=predicted_sway(f.model, f.theta, standing, f.lines),
        forecasts=forecasts(
            f.model,
            f.theta,
            f.lines,
            quantities(f.model, wanted),
            f.estimates,
            f.level,
            _higher(recording, f.lines, discard),
        ),
        gap=gap,
        comparison=comparison,
        paper=paper_estimate(f.model, base, f.lines, seed),
        coverage=nearest(f),
    )


def _higher(recording: AnyRecording, lines: Lines, discard: Discard) -> Lines | None:
    """The lines of the recording up to the next of `HIGHER_HZ`, None where it has none."""
    top = float(lines.f.max())
    wanted = next((f for f in HIGHER_HZ if f > CLEARLY * top), None)
    if wanted is None:
        return None
    parts = recording.parts if isinstance(recording, JointRecording) else (recording,)
    try:
        higher = joined([measure(p, wanted, discarded(discard, k)) for k, p in enumerate(parts)])
        require_noise(higher, recording.name)
    except RecordingError:  # what the recording does not hold cannot be forecast
        return None
    return higher if higher.f.max() > CLEARLY * top else None
