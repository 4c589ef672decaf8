"""Check of the channel labels of a recording against the responses that every standing body must have.

Above about 2 Hz the stimulus acts on inertia alone, so the responses approach M^-1 b for every controller. Below, they
stay within a small factor of the nominal model. A mislabelled channel (degrees for radians, theta1 and theta2
exchanged, a wrong sign, the angle of the trunk in space instead of the hip angle, a torque in kgf m, an angular
velocity for an angle) multiplies the responses by a known 2 x 2 matrix T. Each possible labelling, called a reading, is
scored by the likelihood of the band means of the measured FRFs around T H0. H0 is the nominal model; the spread is its
error (`MODEL_ERROR`) plus the measured covariance. The result is the log odds of the reading against the labels as
given, of angles that may be low-passed (`FILTERED`). Derived.

A tilt acts on the senses and not on inertia, so its responses differ between people at all frequencies. H0 is then each
of `PEOPLE` random bodies in turn, and the likelihood is the mean over them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.special import fdtrc

from mcstudy.errors import InputError, RecordingError
from mcstudy.lines.base_fit import base_fit
from mcstudy.lines.reading_fits import Search
from mcstudy.lines.readings import READINGS, butterworth
from mcstudy.recordings.copies import CODE as COPY
from mcstudy.recordings.recording import Recording, Suspicion
from mcstudy.recordings.soundness import CODES
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import stream
from mcstudy.text_tables import p_words

EDGES_HZ = (0.05, 0.15, 0.3, 0.5, 0.8, 1.3, 2.0, 3.0, 4.5, 6.5, 9.0)
"""Edges of the bands that are compared; the model error counts as independent between bands."""

MODEL_ERROR = ((0.05, 0.9), (0.8, 0.8), (2.0, 0.5), (4.5, 0.35), (9.0, 0.35))
"""(frequency in Hz, relative error of the nominal model for any person), interpolated in log frequency."""

CERTAIN = 12.0
"""Log odds from which a recording is refused; between `DOUBTFUL` and this it gets a warning."""

DOUBTFUL = 4.0

NO_RESPONSE = 1e-3
"""p-value, corrected for the number of bands and angles, above which a recording has no response. With two trials of
six cycles and the usual noise, the responses to 1.5 N m have less than 1e-6 (4 simulated recordings of one body),
and those to 0.5 N m cannot be distinguished from noise."""

FILTERED = 0.02
"""Prior probability of low-passed angles beside correct ones. Their responses fade as an integral's do, but a filter is
judged by the fit."""

CORNERS_HZ = (1.5, 3.0, 6.0)
"""Corners of these filters."""

NOTED = (*dict.fromkeys(CODES.values()), "amplitude", COPY)
"""Codes of the warnings of `mcstudy.recordings.checks`, which do not refuse a recording by its labels."""


PEOPLE = 200
"""Bodies whose responses to a tilt are compared, the nominal one first."""

GAINS, DELAYS = (0.5, 1.7), (0.75, 1.25)
"""Their gains and delays relative to the nominal ones, uniform; their sensory weights are uniform over the bounds."""

PERSON_ERROR = 0.35
"""Relative distance of a person's responses to a tilt from the nearest of these bodies."""


@lru_cache(maxsize=8)
def bodies(model: Model) -> np.ndarray:
    """Parameters (K, P) of the bodies that a person is compared with: the nominal one, or for a tilt `PEOPLE`."""
    if not model.weights:
        return model.truth[None]
    rng, drawn = stream(0, "label people"), [model.truth[None]]
    free = np.isin(model.names, model.weights)
    low, high = np.where(np.isin(model.names, model.delays), np.array(DELAYS)[:, None], np.array(GAINS)[:, None])
    while sum(map(len, drawn)) < PEOPLE:
        theta = model.truth * rng.uniform(low, high, (PEOPLE, low.size))
        theta[:, free] = rng.uniform(model.lower[free], model.upper[free], (PEOPLE, int(free.sum())))
        drawn.append(theta[growth_rate(model, theta) < 0])
    return np.concatenate(drawn)[:PEOPLE]


def band_means(lines: Lines, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frequencies (B,), measured FRFs (B, 2), those of K `bodies` (K, B, 2) and covariance (B, 2, 2), by band.

    Each line is divided by the nominal magnitude and averaged with inverse-variance weights."""
    every = frf(model, bodies(model), lines.f)
    H = every[0]
    f, y, h, C = [], [], [], []
    for low, high in pairwise(EDGES_HZ):
        inside = (lines.f >= low) & (lines.f < high)
        if not inside.any():
            continue
        scale = np.abs(H[inside])
        noise = lines.noise.variance[inside] / scale**2
        w = 1 / (noise.mean(axis=1) + 1e-300)
        w /= w.sum()
        # Without rotation by the nominal phase of the first angle, lines of different phase would cancel in the mean.
        turn = np.exp(-1j * np.angle(H[inside, :1]))
        f.append(float(w @ lines.f[inside]))
        y.append(w @ (lines.y[inside] * turn / scale.mean(axis=1, keepdims=True)))
        h.append(w @ (every[:, inside] * turn / scale.mean(axis=1, keepdims=True)))
        C.append(np.einsum("n,nij->ij", w**2 / scale.mean(axis=1) ** 2, lines.noise.C[inside]))
    return np.array(f), np.array(y), np.moveaxis(np.array(h), 0, 1), np.array(C)


def readings(recording: Recording, lines: Lines) -> dict[str, float]:
    """Log likelihood of every reading, "as_labelled" included."""
    f, y, h, C = band_means(lines, recording.base_model())
    at, size = np.array(MODEL_ERROR).T
    error = np.interp(np.log(f), np.log(at), size) if len(h) == 1 else np.full(f.size, PERSON_ERROR)
    unit = recording.stimulus_unit
    judged = {n: r.at(f) for n, r in READINGS.items() if r.check != "fit" and not (r.torque and unit != "N m")}
    filters = _low_passes(f)
    T = np.concatenate([filters, *(t[None] for t in judged.values())])[:, None]  # (filters and readings, 1, N, 2, 2)
    expected = (T @ h[..., None])[..., 0]
    S = C + (T * (error[:, None] * np.abs(h))[..., None, :] ** 2) @ np.conj(np.swapaxes(T, -1, -2))
    r = y - expected
    misfit = (r.conj() * np.linalg.solve(S, r[..., None])[..., 0]).sum(axis=-1).real
    # Heavy tails, so that one band with a wrong nominal model does not decide.
    score = -(np.log(np.linalg.det(S).real) + 4 * np.log1p(misfit / 4)).sum(axis=-1)
    mean = np.logaddexp.reduce(score, axis=1) - np.log(len(h))
    same, low_passed, others = mean[0], mean[1 : len(filters)], mean[len(filters) :]
    labelled = np.logaddexp(same, np.log(FILTERED / low_passed.size) + np.logaddexp.reduce(low_passed))
    return {"as_labelled": float(labelled), **dict(zip(judged, others.tolist(), strict=True))}


def _low_passes(f: np.ndarray) -> np.ndarray:
    """T (1 + L, N, 2, 2) of correct angles and of L filters of second order, on both angles or one, delayed or not."""
    once = butterworth(1j * f / np.array(CORNERS_HZ)[:, None], 2)
    factors = np.concatenate([once, np.abs(once) ** 2])[:, :, None]
    on = np.array([[True, True], [True, False], [False, True]])[:, None, None, :]
    values = np.where(on, factors, 1.0).reshape(-1, f.size, 2)
    return np.concatenate([np.ones((1, f.size, 2)), values])[..., None] * np.eye(2)


def no_response(lines: Lines) -> float:
    """p-value of the clearest band of an angle under noise alone, not corrected for their number.

    |y|^2 over its noise variance is F distributed without a response.
    """
    least = 1.0
    for low, high in pairwise(EDGES_HZ):
        inside = (lines.f >= low) & (lines.f < high)
        if inside.any():
            ratio = (np.abs(lines.y[inside]) ** 2 / lines.noise.variance[inside]).mean(axis=0)
            m, nu = 2 * int(inside.sum()), 2 * float(lines.noise.dof[inside].mean())
            least = min(least, float(fdtrc(m, nu, ratio).min()))
    return least


def _require_response(recording: Recording, lines: Lines, of_one: Sequence[Lines], single: Sequence[Suspicion]) -> None:
    """Raise `RecordingError` unless some band of some angle holds more than noise in the mean over all trials.

    Trials ``of_one`` may each have a response and cancel each other, as those of opposite sign do. Then the first
    suspicion of a ``single`` trial is the reason, which nobody can overrule: without a response nothing is left to
    diagnose, and the labels of the whole recording cannot be checked.
    """
    tests = 2 * len(EDGES_HZ)
    p = no_response(lines)
    if p * tests <= NO_RESPONSE:
        return
    clear = [
        k for k, lines_of_trial in enumerate(of_one) if no_response(lines_of_trial) * tests * len(of_one) <= NO_RESPONSE
    ]
    if not clear:
        raise RecordingError(
            f"{recording.name}: theta1, theta2: no response to the stimulus beyond noise ({p_words(p)} in the "
            "clearest band); expected the angles that were recorded with this stimulus"
        )
    reason = single[0].message if single else f"{recording.name}: theta1, theta2: expected trials that agree"
    raise RecordingError(
        f"{reason}; the trials cancel each other, so their mean has no response to the stimulus beyond noise "
        f"({p_words(p)} in the clearest band)"
    )


def plausibility(recording: Recording, lines: Lines) -> tuple[Suspicion, ...]:
    """Readings that explain the responses better than the labels do, best first, then those of single trials.

    A single mislabelled trial is tested alone, because the mean over correct and wrong trials matches no reading. It
    is reported only when it is certain (`CERTAIN`) and the whole recording does not have the same reading. Then a
    reading that some trial certainly does not have is none of the whole recording: the mean over its trials shows it
    because of the other ones. Raises `RecordingError` without a response to the stimulus, in the trials or their mean.

    The nominal model may be far from a person whose labels are right. So what is certain by it is reported only if some
    body fits the responses under that reading better than any body fits them as labelled.
    """
    trials = np.unique(lines.trial)
    alone = {int(k): _own(lines.subset(lines.trial == k)) for k in trials} if trials.size > 1 else {}
    odds_of = {k: label_odds(recording, trial_lines) for k, trial_lines in alone.items()}
    single = []
    for k, odds in odds_of.items():
        single += [(s, k) for s in _doubts(odds, f"{recording.name}: trial {k + 1}", CERTAIN)[:1]]
    _require_response(recording, lines, list(alone.values()), [s for s, _ in single])
    suspicions = _doubts(label_odds(recording, lines), recording.name, DOUBTFUL)
    if single:
        suspicions = [s for s in suspicions if min(odds[s.code] for odds in odds_of.values()) > -CERTAIN]
        single = [(s, k) for s, k in single if s.code not in {f.code for f in suspicions}]
    return _confirmed([*((s, None) for s in suspicions), *single], recording, lines)


def _confirmed(
    doubts: Sequence[tuple[Suspicion, int | None]], recording: Recording, lines: Lines
) -> tuple[Suspicion, ...]:
    """Suspicions of all trials or one, without the certain ones that fit worse than the labels do."""
    if all(s.odds < CERTAIN for s, _ in doubts):
        return tuple(s for s, _ in doubts)
    as_labelled = base_fit(lines, recording.base_model(), 0)
    search = Search(lines, as_labelled.best, as_labelled.minima, 0)

    def better(code: str, trial: int | None) -> bool:
        return search.thoroughly(search.only(READINGS[code].at(lines.f), trial))[0] > as_labelled.best.log_evidence

    return tuple(s for s, trial in doubts if s.odds < CERTAIN or better(s.code, trial))


def _own(lines: Lines) -> Lines:
    """Lines of one trial with noise of its own size, per angle: a wrong unit of another trial scales the common noise.

    Unchanged with a single repeat, or without noise.
    """
    n = len(lines.repeats)
    if n < 2:
        return lines
    scatter = (lines.weight[..., None] * np.abs(lines.repeats - lines.y) ** 2).sum(axis=0) / (n - 1)
    size = np.sqrt((scatter / np.maximum(lines.noise.variance, 1e-300)).mean(axis=0))
    if not (np.isfinite(size).all() and (size > 0).all()):
        return lines
    return replace(lines, noise=replace(lines.noise, C=lines.noise.C * np.outer(size, size)))


def label_odds(recording: Recording, lines: Lines) -> dict[str, float]:
    """Log odds of every reading against the labels as given."""
    score = readings(recording, lines)
    base = score.pop("as_labelled")
    return {name: x - base for name, x in score.items()}


def _doubts(score: dict[str, float], where: str, least: float) -> list[Suspicion]:
    """Readings with log odds ``score`` of at least ``least`` over the labels as given, best first."""
    doubts = []
    for name in sorted(score, key=lambda n: -score[n]):
        odds = score[name]
        if odds < least:
            break
        reading = READINGS[name]
        if reading.check == "certain" and odds < CERTAIN:
            continue
        doubts.append(
            Suspicion(name, reading.channel, f"{where}: {reading.channel}: seems to be {reading.words}", odds)
        )
    return doubts


def merged(*suspicions: Iterable[Suspicion]) -> tuple[Suspicion, ...]:
    """All suspicions in the order found; each message once, with its largest odds."""
    strongest: dict[str, Suspicion] = {}
    for s in (s for some in suspicions for s in some):
        if s.message not in strongest or s.odds > strongest[s.message].odds:
            strongest[s.message] = s
    return tuple(strongest.values())


def refuse(suspicions: Iterable[Suspicion], accept: Iterable[str] = ()) -> None:
    """Raise `RecordingError` for channels that are certainly mislabelled, strongest suspicion first.

    ``accept``: codes of suspicions that the user has checked; every suspicion needs its own. Raises `InputError` for an
    unknown code.
    """
    accepted = {accept} if isinstance(accept, str) else set(accept)
    if unknown := accepted - {*READINGS, *NOTED}:
        raise InputError(
            f"accept: expected codes among {', '.join((*READINGS, *NOTED))}, got {', '.join(sorted(unknown))}"
        )
    left = [s for s in suspicions if s.code in READINGS and s.code not in accepted and s.odds >= CERTAIN]
    if left:
        left.sort(key=lambda s: -s.odds)
        codes = " and ".join(dict.fromkeys(repr(s.code) for s in left))
        first = left[0]
        raise RecordingError(
            f"{first.message} (odds 10^{first.odds / np.log(10):.0f} to 1); accept {codes} to keep the labels"
        )
