"""The fit of one recording: from lines to estimates with intervals."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from mcstudy.effect_library.library import apply
from mcstudy.errors import RecordingError
from mcstudy.files.json_files import named
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.assessment import assessed
from mcstudy.identification.bounds import bounded
from mcstudy.identification.correction import DRAWS, Draws, simulated
from mcstudy.identification.estimate import BANDS_HZ, Estimate
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.minimum import MISSED, Minima, search, without_prior
from mcstudy.identification.profile import CURVE, Linearised, Profile, profiles
from mcstudy.identification.settings import FitMethod, FitSettings
from mcstudy.identification.threshold import Threshold, factor, threshold
from mcstudy.lines.checked_recording import CheckedRecording
from mcstudy.lines.part_fits import PartFit, part_fits
from mcstudy.lines.settling import settled
from mcstudy.models.quantities import Quantity, quantities, require_finite
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import AnyRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import copies, split
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream


def fit(recordings: AnyRecording | Sequence[Recording | FrfRecording], settings: FitSettings) -> FitRecord:
    """Parameters of the person in a recording, or in several of one person; see `mcstudy.fit`.

    Raises `RecordingError` for a recording that cannot be analysed, `InputError` for a wrong quantity, bound or effect.
    """

    def best_of(checked: CheckedRecording) -> BestFit:
        return searched(checked.lines, checked.nominal, settings, checked.recording.name)

    checked, best = settled(recordings, settings, best_of)
    result = with_intervals(replace(best, lines=checked.lines), settings, checked.recording.name)
    result = replace(
        result,
        recording=checked.recording,
        warnings=(*checked.warnings, *result.warnings),
        method=replace(result.method, fmax=checked.fmax, discard=checked.discard),
    )
    return assessed(result, checked, _base(checked.nominal, settings), settings)


def fit_lines(
    lines: Lines,
    nominal: Model,
    settings: FitSettings = FitSettings(),
    *,
    name: str = "lines",
    curve: Sequence[float] = CURVE,
    draws: Draws | None = None,
) -> FitRecord:
    """The fit of measured lines.

    Parameters
    ----------
    nominal: model with values of the order of magnitude of a person's.
    curve: see `mcstudy.identification.profile.profiles`. draws: for the correction, where many recordings share them.
    """
    return with_intervals(searched(lines, nominal, settings, name), settings, name, curve, draws)


@dataclass(frozen=True)
class BestFit:
    """What the search of the lowest minimum found.

    ``model`` is ``nominal`` with effects and bounds, ``quantities`` are those whose intervals are wanted.
    """

    lines: Lines
    nominal: Model
    model: Model
    data: Data
    fitter: Fitter
    minima: Minima
    quantities: tuple[Quantity, ...]

    @property
    def theta(self) -> np.ndarray:
        """Parameters (P,) of the lowest minimum."""
        return self.minima.theta[0]


def searched(lines: Lines, nominal: Model, settings: FitSettings, name: str, separate: Collection[str] = ()) -> BestFit:
    """The lowest minimum of the fit of measured lines.

    ``separate``: parameters that have a value in each of several conditions. Raises `RecordingError` for too few lines.
    """
    model, nominal = fitted_model(nominal, settings, separate), split(nominal, separate)
    numbers = 2 * lines.y.shape[1]  # of one line
    if numbers * len(lines) <= len(model.parameters):
        raise RecordingError(
            f"{name}: expected more than {len(model.parameters) // numbers} {lines.unit}s, got {len(lines)}"
        )
    data, wanted = Data.of(lines), quantities(model, settings.quantities)
    fitter = Fitter(model, without_prior(model, nominal), lines.f)
    return BestFit(lines, nominal, model, data, fitter, search(fitter, data, settings.seed), wanted)


def fitted_model(nominal: Model, settings: FitSettings, separate: Collection[str] = ()) -> Model:
    """``nominal`` with effects and bounds; bounds of a parameter hold of its ``separate`` copies, too."""
    whole, given = apply(nominal, *settings.effects), settings.bounds or {}
    names = copies(whole, separate)
    both = {copy: given[name] for name, at in names.items() if name in given for copy in at.values()}
    both |= {name: ends for name, ends in given.items() if name not in names}
    return bounded(split(whole, separate), split(nominal, separate), both)


def with_intervals(
    best: BestFit, settings: FitSettings, name: str, curve: Sequence[float] = CURVE, draws: Draws | None = None
) -> FitRecord:
    """The estimates at the lowest minimum, with profile likelihood intervals."""
    lines, model, data, minima, theta = best.lines, best.model, best.data, best.minima, best.theta
    level, seed = settings.level, settings.seed
    require_finite(model, best.quantities, theta)
    drawn = draws or simulated(lines.noise, stream(seed, "fit correction"))
    rise = threshold(model, data, minima, best.quantities, drawn, level)
    null, linearised = rise.null_chi2, rise.near
    intervals = profiles(best.fitter, data, minima, best.quantities, rise.rise, curve)
    error = ndtri(0.5 + level / 2) * np.sqrt(linearised.variance)
    share = _information(rise.jacobian @ linearised.tangent.T, lines.f)
    estimates = zip(best.quantities, intervals, error, share, strict=True)
    return FitRecord(
        name=name,
        level=level,
        estimates=tuple(_estimate(q, theta, p, e, s) for q, p, e, s in estimates),
        theta=theta,
        chi2=float(minima.chi2[0]),
        expected_chi2=float(null.mean()),
        p_value=float((1 + (null >= minima.chi2[0]).sum()) / (1 + null.size)),
        growth_rate=float(growth_rate(model, theta)),
        correlation=_correlation(linearised),
        minima=minima,
        model=model,
        lines=lines,
        warnings=(*_warnings(minima.missed), *_widened(rise, best.quantities, level), *lines.notes),
        method=FitMethod("ml", seed, tuple(settings.effects)),
        without=_without(lines, best.nominal, settings) if settings.effects else None,
        part_fits=_part_fits(lines, data, theta, model, rise, seed) if len(lines.parts) > 1 else (),
    )


def _part_fits(
    lines: Lines, data: Data, theta: np.ndarray, model: Model, rise: Threshold, seed: int
) -> tuple[PartFit, ...]:
    """Goodness of fit of each recording; null samples are those of the linearised fit, without bounds that hold it."""
    noise = lines.noise.draw(stream(seed, "fit parts"), DRAWS)
    taken = np.linalg.qr(rise.jacobian[:, rise.near.free])[0]
    residual = whiten(data.weight, data.y - frf(model, theta, data.f))
    return part_fits(lines, residual, noise - taken @ (taken.T @ noise))


def _without(lines: Lines, nominal: Model, settings: FitSettings) -> Minima:
    """Minima of the model without effects."""
    model = _base(nominal, settings)
    return search(Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines), settings.seed)


def _base(nominal: Model, settings: FitSettings) -> Model:
    """The model without effects, with the bounds of the fit."""
    bounds = settings.bounds or {}
    return bounded(nominal, nominal, {name: ends for name, ends in bounds.items() if name in nominal.names})


def _estimate(q: Quantity, theta: np.ndarray, p: Profile, error: float, share: np.ndarray) -> Estimate:
    value = q.value(theta)
    return Estimate(
        **named(q, "name", "unit"),
        estimate=value,
        **named(p, "low", "high", "low_from", "high_from"),
        wald_low=value - error,
        wald_high=value + error,
        information=tuple(map(float, share)),
        profile=p,
    )


def _information(sensitivity: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Share (K, bands) of the information on K quantities; ``sensitivity`` (2 N Y, K) of the whitened responses."""
    by_line = (sensitivity.reshape(2, f.size, -1, sensitivity.shape[1]) ** 2).sum(axis=(0, 2))
    band = np.searchsorted(BANDS_HZ, f, side="right") - 1
    share = np.array([by_line[band == b].sum(axis=0) for b in range(len(BANDS_HZ) - 1)]).T
    total = share.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(share, total, out=np.full_like(share, np.nan), where=total > 0))


def _correlation(linearised: Linearised) -> np.ndarray:
    out = np.full((linearised.free.size, linearised.free.size), np.nan)
    scale = np.sqrt(np.diag(linearised.covariance))
    out[np.ix_(linearised.free, linearised.free)] = linearised.covariance / np.outer(scale, scale)
    return out


def _warnings(missed: float) -> tuple[str, ...]:
    if missed <= MISSED:
        return ()
    return (f"one start in {1 / missed:.0f} would end in a minimum not seen yet; a lower one may have been missed",)


def _widened(rise: Threshold, wanted: Sequence[Quantity], level: float) -> tuple[str, ...]:
    names = [q.name for q, several in zip(wanted, rise.several, strict=True) if several]
    if not names:
        return ()
    return (
        "another minimum fits almost as well, and chance decides which of them is the lower; the intervals of "
        f"{', '.join(names)} are therefore wider: their threshold is {factor(level):.2f} times as high",
    )
