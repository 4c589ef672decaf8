"""What a mechanism leaves of the gap, as a torque with a rational transfer function.

Every path (`mcstudy.gap.candidates.rational_torque`) with 0 to 3 poles is added to the model with the mechanism and
fitted with all other parameters. Whether a torque remains is decided by evidence (Laplace's approximation). Half of the
prior probability is that of no further torque, the other half is shared by the candidates.

Paths and numbers of poles are weighted by Akaike's criterion, which estimates how well each predicts new lines (Akaike
1978; for many lines it is that of leaving out one after the other, Stone 1977). Evidence is too sure here: where a pole
is not determined, Laplace's approximation counts one of many places where it could be.

Intervals are those of samples from the normal approximations of the posterior, shared among the numbers of poles by
their weights. So they include the uncertainty of all other parameters and of the number of poles, but not that of the
path. Where a fit leaves more than noise, its covariance is enlarged by chi2 over the number of data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.fitting.penalised import Fitted, Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.rational_torque import MOST_POLES, Loop, Path, extended, linear_start, next_starts, paths
from mcstudy.gap.questions.interval import Interval

NOTHING = 0.5
"""Prior probability that the mechanism leaves no torque."""

STARTS = 2
"""Start values of a further fraction."""

SMALL = 15.0
"""Squared residual beyond noise that data of less weight have."""

LARGE = 50.0
"""Squared residual beyond noise from which fits start with data of less weight."""

STEP = 2.5
"""Factor between the weights of successive fits."""

CHI2_ONE, CHI2_TWO = 3.841, 5.991
"""95 % quantiles of chi-squared with one and two degrees of freedom."""

SAMPLES = 600
"""Samples of the posterior."""


@dataclass(frozen=True)
class RemainingTorque:
    """The corrective torque that the data leave unexplained once a mechanism is in the model.

    Attributes
    ----------
    row, sense
        The torque acts at ``row`` of the model and depends on ``sense``, an angle or the stimulus.
    probability
        Probability that a torque remains at all.
    path_probability
        Akaike weight of this row and sense among all, if one remains.
    poles
        The number of poles of this path with the largest Akaike weight, 0 to 3.
    poles_weight
        (4,) Akaike weight of 0 to 3 poles.
    unit
        That of a torque per angle or per unit of the stimulus; empty where it is unknown.
    numerator, denominator
        Of the best fit with so many poles: polynomials in ascending powers of s. The transfer function has ``unit``.
    rms
        Root mean square of the torque, N m, in these recordings (`Interval`); None without time series. The lower
        limit is 0 if no torque is found.
    share
        The same relative to the active torque of that joint (`Interval`); None for a joint without active torque.
    clearest_hz
        The line that the torque changes most, in standard errors, after all other parameters have been refitted, Hz.
    chi2
        Squared residual with this torque in the model.
    f
        (N,), the lines, Hz.
    gain, gain_low, gain_high
        (N,), median and 95 % limits of the magnitude of the transfer function, in ``unit``; the lower one is 0 where
        the 95 % region of the complex value holds zero.
    phase, phase_low, phase_high
        (N,), the same of its phase, deg, within half a turn of the median; where zero is possible, any phase is.
    """

    row: str
    sense: str
    probability: float
    path_probability: float
    poles: int
    poles_weight: np.ndarray
    unit: str
    numerator: np.ndarray
    denominator: np.ndarray
    rms: Interval | None
    share: Interval | None
    clearest_hz: float
    chi2: float
    f: np.ndarray = field(repr=False)
    gain: np.ndarray = field(repr=False)
    gain_low: np.ndarray = field(repr=False)
    gain_high: np.ndarray = field(repr=False)
    phase: np.ndarray = field(repr=False)
    phase_low: np.ndarray = field(repr=False)
    phase_high: np.ndarray = field(repr=False)

    @property
    def found(self) -> bool:
        """Whether a torque remains more probably than not."""
        return self.probability > 0.5

    def of_lines(self, some: slice) -> RemainingTorque:
        """The same at some of the lines."""
        names = ("f", "gain", "gain_low", "gain_high", "phase", "phase_low", "phase_high")
        return replace(self, **{name: getattr(self, name)[some] for name in names})

    def at(self, f: float) -> tuple[Interval, Interval]:
        """Magnitude and phase (deg) at the line nearest to ``f`` Hz."""
        k = int(np.abs(self.f - f).argmin())
        return (
            Interval(float(self.gain[k]), float(self.gain_low[k]), float(self.gain_high[k])),
            Interval(float(self.phase[k]), float(self.phase_low[k]), float(self.phase_high[k])),
        )


@dataclass(frozen=True)
class _Candidate:
    """One path with a number of poles, fitted."""

    path: Path
    poles: int
    fitted: Fitted
    log_weight: float


def remaining_torque(
    fitted: Fitted, data: Data, power: np.ndarray, rng: np.random.Generator, among: Sequence[Path] | None = None
) -> RemainingTorque:
    """The torque that the fit of a mechanism leaves unexplained.

    ``power``: (N,) of the stimulus at the lines of ``data`` (`mcstudy.spectra.lines.Lines`). ``among``: the paths that
    are considered, all by default.
    """
    loop = Loop.of(fitted, data.f)
    candidates = _candidates(fitted, data, loop, paths(fitted.model) if among is None else among)
    log = np.array([c.log_weight for c in candidates])
    total = np.logaddexp.reduce(log)
    nothing = np.log(NOTHING) + fitted.log_evidence
    remains = bool(total > nothing)
    weight = _akaike_weights(candidates)
    by_path: dict[Path, float] = {}
    for c, w in zip(candidates, weight, strict=True):
        by_path[c.path] = by_path.get(c.path, 0.0) + float(w)
    path = max(by_path, key=lambda p: by_path[p])
    along = [c for c in candidates if c.path == path]
    share = weight[[c.path == path for c in candidates]] / by_path[path]
    best = along[int(share.argmax())]
    by_poles = np.zeros(MOST_POLES + 1)
    by_poles[[c.poles for c in along]] = share
    G = _samples(along, share, data.f, rng)
    gain, phase = np.abs(G), _phases(G)
    k = fitted.model.rows.index(path.row)
    timed = bool(np.isfinite(power).all())
    power = power if timed else np.ones(data.f.size)
    torque = np.sqrt(2 * power @ (gain.T * np.abs(path.signal(loop.H, fitted.model.angles))[:, None]) ** 2)
    active = float(np.sqrt(2 * power @ np.abs(loop.torque[:, k]) ** 2))
    quantiles = np.quantile(gain, (0.5, 0.025, 0.975), axis=0)
    turns = np.quantile(phase, (0.5, 0.025, 0.975), axis=0)
    seen = _seen(fitted, data, loop, path, G.mean(axis=0))
    doubtful = ~_from_zero(G)
    quantiles[1, doubtful] = 0.0
    turns[1:, doubtful] = turns[0, doubtful] + np.array([[-180.0], [180.0]])
    numerator, denominator = path.fraction(best.poles, best.fitted.theta[fitted.theta.size :])
    return RemainingTorque(
        row=path.row,
        sense=path.sense,
        probability=float(np.exp(total - np.logaddexp(total, nothing))),
        path_probability=by_path[path],
        poles=best.poles,
        poles_weight=by_poles,
        numerator=numerator,
        denominator=denominator,
        unit=path.unit(fitted.model),
        f=data.f,
        gain=quantiles[0],
        gain_low=quantiles[1],
        gain_high=quantiles[2],
        phase=turns[0],
        phase_low=turns[1],
        phase_high=turns[2],
        rms=_size(torque, remains) if timed else None,
        share=_size(torque / active, remains) if active > 0 else None,
        clearest_hz=float(data.f[int(seen.argmax())]),
        chi2=best.fitted.chi2,
    )


def _candidates(fitted: Fitted, data: Data, loop: Loop, every: Sequence[Path]) -> list[_Candidate]:
    """The best fit of every path with every number of poles.

    A large gap takes the parameters far from those of the body, and a fit from there ends in a wrong minimum. Fits to
    data of less weight, which the prior keeps near the body, then give further starts, in several steps if needed.
    """
    prior = float(np.log((1 - NOTHING) / (len(every) * (MOST_POLES + 1))))
    steps = [(fitted, data)]
    excess = fitted.chi2 - 2 * fitted.model.n_outputs * data.f.size
    weight = np.sqrt(SMALL / excess) if excess > LARGE else 1.0
    while weight < 1.5 / STEP:
        softer = Data(data.f, data.y, data.weight * weight)
        starts = np.array([fitted.theta, fitted.prior.mean])
        steps.insert(-1, (Fitter(fitted.model, fitted.prior, data.f).best(softer, starts), softer))
        weight *= STEP
    out = []
    for path in every:
        scale, found = loop.scale(path, fitted.model), dict[int, Fitted]()
        for base, weighted in steps:
            found = _by_poles(base, weighted, path, scale, found)
        out += [_Candidate(path, k, best, best.log_evidence + prior) for k, best in found.items()]
    return out


def _by_poles(fitted: Fitted, data: Data, path: Path, scale: float, more: Mapping[int, Fitted]) -> dict[int, Fitted]:
    """The best fit of one path with every number of poles; each starts from those with fewer, and from ``more``."""
    found: dict[int, Fitted] = {}
    waiting: dict[int, list[np.ndarray]] = {k: [more[k].theta] if k in more else [] for k in range(MOST_POLES + 1)}
    waiting[0].append(linear_start(fitted, path))
    for poles, starts in waiting.items():
        best = fitted
        if path.gains(poles):
            model, prior = extended(fitted, path, poles, data.f, scale)
            best = Fitter(model, prior, data.f).best(data, np.clip(np.array(starts), model.lower, model.upper))
            found[poles] = best
        if poles < MOST_POLES:
            for start in next_starts(best, fitted.theta.size, path, poles, data, scale, STARTS):
                waiting[_poles(path, start.size - fitted.theta.size)].append(start)
    return found


def _poles(path: Path, added: int) -> int:
    """Number of poles of a torque with so many parameters."""
    return next(k for k in range(MOST_POLES + 1) if len(path.names(k)) == added)


def _akaike_weights(candidates: list[_Candidate]) -> np.ndarray:
    """Akaike weights of all candidates."""
    aic = np.array([c.fitted.chi2 + c.fitted.penalty + 2 * len(c.path.names(c.poles)) for c in candidates])
    weight = np.exp(-0.5 * (aic - aic.min()))
    return np.asarray(weight / weight.sum())


def _seen(fitted: Fitted, data: Data, loop: Loop, path: Path, G: np.ndarray) -> np.ndarray:
    """(N,) squared change of each line by a transfer function (N,), in standard errors, the parameters refitted."""
    change = whiten(data.weight, loop.change(path, fitted.model) * G[:, None])
    J = fitted.jacobian(data)
    left = change - J @ (fitted.covariance @ (J.T @ change))
    return np.asarray((left.reshape(2, data.f.size, -1) ** 2).sum(axis=(0, 2)))


def _samples(own: list[_Candidate], share: np.ndarray, f: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, N) samples of the transfer function of one path, from all numbers of poles."""
    out = []
    for c, n in zip(own, rng.multinomial(SAMPLES, share), strict=True):
        m = len(c.path.names(c.poles))
        covariance = c.fitted.covariance[-m:, -m:] * max(1.0, c.fitted.chi2 / (2 * c.fitted.model.n_outputs * f.size))
        theta = rng.multivariate_normal(c.fitted.theta[-m:], (covariance + covariance.T) / 2, n, check_valid="ignore")
        theta = np.clip(theta, c.fitted.model.lower[-m:], c.fitted.model.upper[-m:])
        out += [c.path.transfer(c.poles, x, f) for x in theta]
    return np.array(out)


def _size(samples: np.ndarray, found: bool) -> Interval:
    """Of a torque, whose lower limit is 0 if it may not be there."""
    interval = Interval.of(samples)
    return interval if found else Interval(interval.estimate, 0.0, interval.high)


def _from_zero(G: np.ndarray) -> np.ndarray:
    """(N,) whether the 95 % region of samples (n, N) leaves out zero; where it does not, any phase is possible."""
    off = G - G.mean(axis=0)
    a, b, c = (off.real**2).mean(axis=0), (off.imag**2).mean(axis=0), (off.real * off.imag).mean(axis=0)
    x, y = G.mean(axis=0).real, G.mean(axis=0).imag
    scaled = (x * x * b - 2 * x * y * c + y * y * a) / np.maximum(a * b - c * c, 1e-300)
    flat = a * b - c * c <= 1e-12 * (a + b) ** 2  # one gain only: samples lie on a line through zero
    along = (x * x + y * y) / np.maximum(a + b, 1e-300)
    return np.where(flat, along > CHI2_ONE, scaled > CHI2_TWO)


def _phases(G: np.ndarray) -> np.ndarray:
    """Phases of samples (n, N) in deg, within half a turn of that of their mean."""
    middle = G.mean(axis=0)
    centre = np.angle(middle)
    return np.asarray(np.rad2deg(centre + np.angle(G * np.exp(-1j * centre))))
