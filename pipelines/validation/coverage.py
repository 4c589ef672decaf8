"""How often intervals contain the truth: recordings drawn in the frequency domain, fitted as real ones are.

A recording with a periodic stimulus reaches a fit as Fourier coefficients of its cycles. For a linear body in a steady
state these are, at every harmonic, the response to the stimulus plus Gaussian noise with the density of the sway, which
is independent between harmonics and between cycles. They are drawn as such: no record, no window, no leakage. From the
coefficients on, everything is what a real recording meets: the mean over cycles, the covariance of the noise from even
harmonics (`mcstudy.spectra.even_lines`), and the fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from mcstudy.effect_library.library import apply
from mcstudy.effect_library.simulation import simulate
from mcstudy.fitting.penalised import Fitter
from mcstudy.identification.bounds import bounded
from mcstudy.identification.correction import Draws, simulated
from mcstudy.identification.fit import fit_lines
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.minimum import without_prior
from mcstudy.identification.settings import FitSettings
from mcstudy.models.quantities import quantities
from mcstudy.spectra.cycle_noise import understatement
from mcstudy.spectra.even_lines import EvenLineCovariance, half_width
from mcstudy.spectra.line_noise import LineNoise
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import NOISE_HZ, measure
from mcstudy.spectra.null_draws import Pooling
from mcstudy.spectra.periodic import cycle_coefficients, excited_lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf, noise_response
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream
from pipelines.validation.at_truth import judged, starts

TRIALS, DISCARD, AMPLITUDE = 2, 1, 5.0
"""Trials of a recording, cycles discarded at the start of each, and the peak of the torque unless stated, N m."""

LEVEL = 0.95
"""Of all intervals."""

SLOWEST = -0.5
"""Growth rate, 1/s, above which a drawn body is not used: it would sway for minutes after a push."""


def body(number: int, spread: float = 0.2) -> dict[str, float]:
    """True parameters of a body that stands: nominal for 0, otherwise drawn evenly within ``spread`` of these."""
    nominal, rng = two_segment(), stream(number, "coverage")
    theta = nominal.truth
    drawn = number == 0
    while not drawn:
        theta = nominal.truth * (1 + rng.uniform(-spread, spread, nominal.truth.size))
        drawn = float(growth_rate(nominal, theta)) < SLOWEST
    return dict(zip(nominal.names, map(float, theta), strict=True))


@dataclass(frozen=True)
class Condition:
    """A cell of a coverage study: number of the true body (see `body`), cycles of each trial, highest frequency, Hz.

    ``amplitude``: peak of the torque, N m.
    """

    truth: int
    cycles: int
    fmax: float
    amplitude: float = AMPLITUDE


class Source:
    """Draws lines of recordings of one condition, with all that does not depend on the draw done once."""

    def __init__(
        self, condition: Condition, theta: np.ndarray | None = None, effects: Mapping[str, float] | None = None
    ) -> None:
        """``theta``: true parameters (12,) instead of those of the condition's body. ``effects``: sizes by name."""
        sizes = dict(effects or {})
        model = apply(two_segment(), *sizes)
        theta = np.array(list(body(condition.truth).values())) if theta is None else theta
        theta = np.append(theta, list(sizes.values()))
        stimulus, self._period_s = _stimulus()
        stimulus = stimulus * (condition.amplitude / AMPLITUDE)
        excited = excited_lines(stimulus[None])
        self._wanted = excited[excited <= max(condition.fmax, NOISE_HZ) * self._period_s + 0.5]
        self._fmax = condition.fmax
        self.f = self._wanted / self._period_s
        self._estimator = EvenLineCovariance(
            self._wanted, stimulus.size - 1, (TRIALS, TRIALS * (condition.cycles - DISCARD - 1))
        )
        self._cycles = condition.cycles - DISCARD
        harmonics = np.arange(1, self._estimator.even[-1] + 1)
        response = noise_response(model, theta, harmonics / self._period_s)
        density = SensorNoise().psd(harmonics / self._period_s)
        self._root = response * np.sqrt(density / (2 * self._period_s))[:, None, :]
        self._response, self._stimulus = frf(model, theta, self.f), stimulus[self._wanted]
        self._understated = understatement(self._wanted, TRIALS)[:, None, None]
        further = TRIALS * (self._cycles - 1)
        self._pooling = Pooling(self._wanted.astype(float), half_width(self._wanted) + 1.0, colour_records=further)

    def __call__(self, rng: np.random.Generator) -> Lines:
        """Lines of a random recording."""
        R = self._cycles
        white = rng.standard_normal((TRIALS, R, *self._root.shape[:2], 2)).view(complex)[..., 0] * np.sqrt(0.5)
        noise = np.zeros((TRIALS, R, len(self._root) + 1, 2), dtype=complex)
        noise[:, :, 1:] = self._root[..., 0] * white[..., :1] + self._root[..., 1] * white[..., 1:]
        means = noise.mean(axis=1) * np.sqrt(R)
        differences = (_contrasts(R) @ noise.reshape(TRIALS, R, -1)).reshape(TRIALS * (R - 1), -1, 2)
        total = TRIALS * R * np.abs(self._stimulus) ** 2
        covariance = self._understated * self._estimator(means, differences) * TRIALS / total[:, None, None]
        repeats = self._response + noise[:, :, self._wanted].reshape(TRIALS * R, -1, 2) / self._stimulus[:, None]
        return Lines(
            f=self.f,
            y=repeats.mean(axis=0),
            noise=LineNoise(covariance, self._estimator.dof * TRIALS, self._pooling),
            repeats=repeats,
            weight=np.full(repeats.shape[:2], 1 / len(repeats)),
            trial=np.repeat(np.arange(TRIALS), R),
            cycle=np.tile(np.arange(R), TRIALS),
            amplitude=np.full(TRIALS * R, np.nan),
            power=np.abs(self._stimulus) ** 2,
            harmonic=self._wanted,
        ).below(self._fmax)

    def draws(self, fmax: float | None = None) -> Draws:
        """What the correction of all recordings of this condition shares; of their lines up to ``fmax`` if given."""
        noise = LineNoise(np.empty((self.f.size, 2, 2)), self._estimator.dof * TRIALS, self._pooling)
        return simulated(noise.at(self.f <= (fmax or self._fmax)), stream(0, "fit correction"))


COLUMNS = ("estimate", "low", "high", "low_by_data", "high_by_data", "wald_low", "wald_high")
"""What is kept of every interval; the two in the middle are 1 where data, not bounds, end it, and -1 where the search
did not converge."""

ABOUT = ("p_value", "starts", "minima")
"""What is kept of every fit: its goodness of fit, the starts of the search, and the minima within reach."""


def intervals(condition: Condition, first: int, last: int, time_domain: bool = False) -> dict[str, np.ndarray]:
    """Fits of realizations ``first`` ... ``last`` - 1: ``intervals`` (R, K, len(COLUMNS)), ``about`` (R, len(ABOUT)).

    ``time_domain``: simulate every recording sample by sample and measure it, as in an experiment.
    """
    source, model = Source(condition), two_segment()
    draws = source.draws()
    fits = []
    for r in range(first, last):
        if time_domain:
            amplitudes = (condition.amplitude,) * TRIALS
            recording = simulate(
                parameters=body(condition.truth), amplitude=amplitudes, cycles=condition.cycles, seed=r
            )
            lines = measure(recording, condition.fmax, DISCARD)
        else:
            lines = source(stream(r, f"coverage {condition.truth} {condition.cycles}"))
        fits.append(fit_lines(lines, model, FitSettings(seed=r), curve=(), draws=None if time_domain else draws))
    return {
        "intervals": np.array([[_row(e) for e in f.estimates] for f in fits]),
        "about": np.array([(f.p_value, f.minima.starts, _reached(f)) for f in fits], dtype=float),
    }


JUDGED = ("contained", "estimate", "wald_low", "wald_high", "rise")
"""What is kept of every test; see `pipelines.validation.at_truth.Judged`."""

LOW_HZ, FEW, MANY = 2.0, 12, 48
"""Random starts of each search: few, and many up to a frequency below which more minima are deep."""


def opened() -> dict[str, tuple[float, float]]:
    """Bounds so wide that a fit rarely ends on one: gains -20 to 40 times nominal, delays 1 ms to 1 s."""
    nominal = two_segment()
    return {
        p.name: (0.001, 1.0) if p.name in nominal.delays else (-20 * p.value, 40 * p.value) for p in nominal.parameters
    }


def judgements(
    truth: int,
    cycles: int,
    fmax: Sequence[float],
    first: int,
    last: int,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    effects: Mapping[str, float] | None = None,
    amplitude: float = AMPLITUDE,
) -> dict[float, np.ndarray]:
    """Whether intervals of realizations ``first`` ... ``last`` - 1 contain the truth, (R, K, len(JUDGED)) by fmax.

    Up to `NOISE_HZ` the recordings are those of `intervals`. ``bounds``: of the fits, as in `mcstudy.fit`.
    ``effects``: sizes by name of linear effects that the body has and the fits estimate too. ``amplitude``: of the
    torque, N m.
    """
    sizes = dict(effects or {})
    source, nominal = Source(Condition(truth, cycles, max(fmax), amplitude), effects=sizes), two_segment()
    model = bounded(apply(nominal, *sizes), nominal, bounds or {})
    theta = np.array([*body(truth).values(), *sizes.values()])
    wanted, seeds = quantities(model), range(first, last)
    drawn = [source(stream(r, f"coverage {truth} {cycles}")) for r in seeds]
    found: dict[float, np.ndarray] = {}
    before = None
    for highest in sorted(fmax, key=lambda f: (f < LOW_HZ, f)):
        lines = [x.below(highest) for x in drawn]
        fitter = Fitter(model, without_prior(model, nominal), lines[0].f)
        further = starts(fitter, seeds, MANY if highest < LOW_HZ else FEW, before)
        before = judged(fitter, lines, wanted, theta, _draws(cycles, max(fmax), highest), LEVEL, further)
        best = np.array([m.theta[0] for m in before.minima])
        estimate = np.array([[q.value(x) for q in wanted] for x in best])
        error = ndtri(0.5 + LEVEL / 2) * np.sqrt([n.variance for n in before.near])
        columns = before.contained, estimate, estimate - error, estimate + error, before.rise
        found[highest] = np.stack(columns, axis=-1)
    return found


def truths(number: int, names: list[str], effects: Mapping[str, float] | None = None) -> np.ndarray:
    """True values (K,) of quantities that are parameters, sizes of ``effects`` (by their name) or sums of them."""
    sizes = dict(effects or {})
    values = dict(zip(apply(two_segment(), *sizes).names, [*body(number).values(), *sizes.values()], strict=True))
    return np.array([sum(values[part] for part in name.split(" + ")) for name in names])


def _row(e: object) -> tuple[float, ...]:
    ends = {"data": 1.0, "bound": 0.0, "not finite": 0.0, "steps": -1.0}
    values = {name: getattr(e, name, None) for name in COLUMNS}
    values |= {f"{side}_by_data": ends[getattr(e, f"{side}_from")] for side in ("low", "high")}
    return tuple(values[name] for name in COLUMNS)  # type: ignore[misc]


def _reached(fit: FitRecord) -> int:
    return int((fit.minima.chi2 - fit.minima.chi2[0] < 4).sum())


@lru_cache
def _stimulus() -> tuple[np.ndarray, float]:
    """Fourier coefficients (K,) of the stimulus of one cycle, as the body feels it, and its period, s."""
    recording = simulate(amplitude=(AMPLITUDE,), cycles=DISCARD + 2, noise=0.0)
    assert recording.period_s is not None
    highest = recording.rate_hz / 2.2
    return cycle_coefficients(recording, highest, DISCARD).stimulus[0], recording.period_s


@lru_cache
def _draws(cycles: int, widest: float, highest: float) -> Draws:
    """`Source.draws` of lines up to ``highest``, Hz: they are the same for every body."""
    return Source(Condition(0, cycles, widest)).draws(highest)


def _contrasts(n: int) -> np.ndarray:
    """Orthonormal differences (n - 1, n) between n cycles."""
    return np.linalg.qr(np.eye(n) - np.full((n, n), 1.0 / n))[0][:, : n - 1].T
