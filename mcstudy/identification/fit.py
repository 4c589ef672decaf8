"""The fit of one recording: from lines to estimates with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from mcstudy.effect_library.library import apply
from mcstudy.errors import InputError, RecordingError
from mcstudy.fitting.penalised import Data, Fitter, whiten
from mcstudy.identification.bounds import bounded
from mcstudy.identification.complete import complete
from mcstudy.identification.correction import DRAWS, Draws, simulated
from mcstudy.identification.minimum import MISSED, Minima, search, without_prior
from mcstudy.identification.profile import CURVE, Linearised, Profile, profiles
from mcstudy.identification.quantities import Quantity, quantities, require_finite
from mcstudy.identification.result import Estimate, FitResult
from mcstudy.identification.several_minima import factor
from mcstudy.identification.tables import BANDS_HZ
from mcstudy.identification.threshold import Threshold, threshold
from mcstudy.lines.checked_recording import Discard, checked_lines, given_model
from mcstudy.lines.part_fits import PartFit, part_fits
from mcstudy.lines.settling import cycles_to_discard, longer, unsettled
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint import AnyRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import highest
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream


def fit(
    recording: AnyRecording | Sequence[Recording | FrfRecording],
    *,
    effects: Sequence[str] = (),
    wanted: Sequence[str] | Mapping[str, Any] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    level: float = 0.95,
    model: Model | None = None,
    fmax: float | None = None,
    discard: int | None = None,
    accept: Iterable[str] = (),
    seed: int = 0,
) -> FitResult:
    """Parameters of the person in a recording, or in several of one person; see `mcstudy.fit`.

    Raises `RecordingError` for a recording that cannot be analysed, `InputError` for a wrong argument.
    """

    def fitted(left_out: Discard) -> tuple[AnyRecording, Model, FitResult]:
        one, lines = checked_lines(recording, fmax, left_out, accept)
        nominal = given_model(model, one, lines)
        result = fit_lines(
            lines, nominal, effects=effects, wanted=wanted, bounds=bounds, level=level, seed=seed, name=one.name
        )
        return one, nominal, result

    left_out: Discard = 1 if discard is None else discard
    one, nominal, result = fitted(left_out)
    if discard is None and longer(needed := cycles_to_discard(one, result.model, result.theta), left_out):
        left_out = needed
        one, nominal, result = fitted(left_out)
    noted = () if isinstance(one, FrfRecording) else tuple(s.message for s in one.suspicions)
    method = {**result.method, "fmax": highest(one, fmax), "discard": left_out}
    start = unsettled(one, result.model, result.theta, left_out)
    result = replace(result, recording=one, warnings=(*noted, *result.warnings, *start), method=method)
    return complete(result, one, nominal, _base(nominal, bounds or {}), wanted)


def fit_lines(
    lines: Lines,
    nominal: Model,
    *,
    effects: Sequence[str] = (),
    wanted: Sequence[str] | Mapping[str, Any] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    level: float = 0.95,
    seed: int = 0,
    name: str = "lines",
    curve: Sequence[float] = CURVE,
    draws: Draws | None = None,
) -> FitResult:
    """The fit of measured lines.

    Parameters
    ----------
    nominal: model with values of the order of magnitude of a person's. effects: linear effects that are added to it.
    curve: see `mcstudy.identification.profile.profiles`. draws: for the correction, where many recordings share them.
    """
    if not 0.5 <= level < 1:
        raise InputError(f"level: expected a number from 0.5 to below 1, got {level!r}")
    model = bounded(apply(nominal, *effects), nominal, bounds or {})
    numbers = 2 * model.n_angles  # of one line
    if numbers * len(lines) <= len(model.parameters):
        raise RecordingError(
            f"{name}: expected more than {len(model.parameters) // numbers} {lines.unit}s, got {len(lines)}"
        )
    data, of = Data.of(lines), quantities(model, wanted)
    fitter = Fitter(model, without_prior(model, nominal), lines.f)
    minima = search(fitter, data, seed)
    theta = minima.theta[0]
    require_finite(model, of, theta)
    drawn = draws or simulated(lines.noise, stream(seed, "fit correction"))
    upto = threshold(model, data, minima, of, drawn, level)
    null, near = upto.null_chi2, upto.near
    found = profiles(fitter, data, minima, of, upto.rise, curve)
    error = ndtri(0.5 + level / 2) * np.sqrt(near.variance)
    share = _information(upto.jacobian @ near.tangent.T, lines.f)
    return FitResult(
        name=name,
        level=level,
        estimates=tuple(_estimate(q, theta, p, e, s) for q, p, e, s in zip(of, found, error, share, strict=True)),
        theta=theta,
        chi2=float(minima.chi2[0]),
        expected_chi2=float(null.mean()),
        p_value=float((1 + (null >= minima.chi2[0]).sum()) / (1 + null.size)),
        growth_rate=float(growth_rate(model, theta)),
        correlation=_correlation(near),
        minima=minima,
        model=model,
        lines=lines,
        warnings=(*_warnings(minima.missed), *_widened(upto, of, level), *lines.notes),
        method={"cost": "ml", "seed": seed, "effects": list(effects)},
        without=_without(lines, nominal, bounds or {}, seed) if effects else None,
        part_fits=_part_fits(lines, data, theta, model, upto, seed) if len(lines.parts) > 1 else (),
    )


def _part_fits(
    lines: Lines, data: Data, theta: np.ndarray, model: Model, upto: Threshold, seed: int
) -> tuple[PartFit, ...]:
    """Goodness of fit of each recording; null samples are those of the linearised fit, without bounds that hold it."""
    noise = lines.noise.draw(stream(seed, "fit parts"), DRAWS)
    taken = np.linalg.qr(upto.jacobian[:, upto.near.free])[0]
    residual = whiten(data.weight, data.y - frf(model, theta, data.f))
    return part_fits(lines, residual, noise - taken @ (taken.T @ noise))


def _without(lines: Lines, nominal: Model, given: Mapping[str, tuple[float, float]], seed: int) -> Minima:
    """Minima of the model without effects."""
    model = _base(nominal, given)
    return search(Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines), seed)


def _base(nominal: Model, given: Mapping[str, tuple[float, float]]) -> Model:
    """The model without effects, with the bounds of the fit."""
    return bounded(nominal, nominal, {name: ends for name, ends in given.items() if name in nominal.names})


def _estimate(q: Quantity, theta: np.ndarray, p: Profile, error: float, share: np.ndarray) -> Estimate:
    value = q.value(theta)
    return Estimate(
        name=q.name,
        unit=q.unit,
        estimate=value,
        low=p.low,
        high=p.high,
        low_from=p.low_from,
        high_from=p.high_from,
        wald_low=value - error,
        wald_high=value + error,
        information=tuple(map(float, share)),
        profile=p,
    )


def _information(sensitivity: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Share (K, bands) of the information on K quantities; ``sensitivity`` (4 N, K) of the whitened responses."""
    by_line = (sensitivity.reshape(2, f.size, 2, -1) ** 2).sum(axis=(0, 2))
    band = np.searchsorted(BANDS_HZ, f, side="right") - 1
    share = np.array([by_line[band == b].sum(axis=0) for b in range(len(BANDS_HZ) - 1)]).T
    total = share.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(share, total, out=np.full_like(share, np.nan), where=total > 0))


def _correlation(near: Linearised) -> np.ndarray:
    out = np.full((near.free.size, near.free.size), np.nan)
    scale = np.sqrt(np.diag(near.covariance))
    out[np.ix_(near.free, near.free)] = near.covariance / np.outer(scale, scale)
    return out


def _warnings(missed: float) -> tuple[str, ...]:
    if missed <= MISSED:
        return ()
    return (f"one start in {1 / missed:.0f} would end in a minimum not seen yet; a lower one may have been missed",)


def _widened(upto: Threshold, of: Sequence[Quantity], level: float) -> tuple[str, ...]:
    names = [q.name for q, several in zip(of, upto.several, strict=True) if several]
    if not names:
        return ()
    return (
        "another minimum fits almost as well, and chance decides which of them is the lower; the intervals of "
        f"{', '.join(names)} are therefore wider: their threshold is {factor(level):.2f} times as high",
    )
