"""What is said about a fit beyond its estimates: each part is a module of its own."""

from __future__ import annotations

from dataclasses import replace

from mcstudy.errors import RecordingError
from mcstudy.gap.questions.any_gap import GapTest
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.identification.averaged import averaged
from mcstudy.identification.averaged_record import Averaged
from mcstudy.identification.belief import gap_found, with_effects
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.forecast import forecasts
from mcstudy.identification.loop_stability import stability
from mcstudy.identification.paper_cost import paper_estimate
from mcstudy.identification.settings import FitSettings
from mcstudy.identification.simulated_coverage import nearest
from mcstudy.identification.sway import predicted_sway
from mcstudy.identification.trades import bodies, valleys
from mcstudy.lines.checked_recording import CheckedRecording, discarded
from mcstudy.models.quantities import quantities
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.spectra.lines import Lines, joined
from mcstudy.spectra.measure import measure, require_noise
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate

HIGHER_HZ = (1.2, 3.1, 8.0)
"""Frequencies up to which lines are added in a forecast: the next one above the fit's."""

CLEARLY = 1.2
"""Factor by which this frequency must exceed the highest line of the fit."""


def assessed(fitted: FitRecord, checked: CheckedRecording, base: Model, settings: FitSettings) -> FitRecord:
    """The fit of a checked recording with everything that is said about it.

    ``base``: the model without effects, with the bounds of the fit.
    """
    f, lines, seed = fitted, checked.lines, settings.seed
    body, comparison = standing(base), None
    gap, test = gap_found(lines, checked.nominal, seed)
    if settings.effects and f.without is not None:
        comparison = with_effects(test, lines, (base, f.model), (f.without, f.minima), settings.effects)
    everybody = bodies(f.estimates)
    stable = everybody[growth_rate(f.model, everybody) < 0]
    wanted, higher = quantities(f.model, settings.quantities), _higher(checked)
    return replace(
        f,
        valleys=valleys(f.model, base, lines, f.minima, f.estimates, f.level, seed),
        stability=stability(f.model, f.theta, f.estimates),
        sway=predicted_sway(f.model, f.theta, stable, lines),
        forecasts=forecasts(f.model, f.theta, lines, wanted, f.estimates, f.level, higher),
        gap=gap,
        comparison=comparison,
        paper=paper_estimate(f.model, base, lines, seed) if body else None,
        coverage=nearest(f.recording, lines, f.model, f.level) if body else None,
        averaged=_averaged(f, test, checked.nominal, settings),
    )


def _averaged(f: FitRecord, test: GapTest, nominal: Model, settings: FitSettings) -> Averaged | None:
    """Parameters averaged over causes where that is wanted, or by default where there is a gap."""
    wanted = test.p_value < LEVEL and not settings.effects if settings.causes is None else settings.causes
    return averaged(test, f, nominal, settings) if wanted else None


def _higher(checked: CheckedRecording) -> Lines | None:
    """The lines of the recording up to the next of `HIGHER_HZ`, None where it has none."""
    recording, top = checked.recording, float(checked.lines.f.max())
    fmax = next((f for f in HIGHER_HZ if f > CLEARLY * top), None)
    if fmax is None:
        return None
    parts = recording.parts if isinstance(recording, JointRecording) else (recording,)
    try:
        higher = joined([measure(p, fmax, discarded(checked.discard, k)) for k, p in enumerate(parts)])
        require_noise(higher, parts[0])
    except RecordingError:  # what the recording does not hold cannot be forecast
        return None
    return higher if higher.f.max() > CLEARLY * top else None
