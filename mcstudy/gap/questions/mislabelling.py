"""Is the recording mislabelled? Every reading of the labels is fitted and competes with the effects of the library.

Under a reading the responses of trial k are T_k(f) times those of the body (`mcstudy.lines.readings`). The
responses are corrected with T_k, weighted with the noise of the recorded ones, and the base model is fitted to them.
Because the quadratic form is that of the recorded responses, the evidence of a reading is comparable with the evidence
of every effect. A reading of one trial also changes how well the trials agree with each other, which enters the
evidence as the change of the squared difference between trials.

In a joint set any one of the recordings may be mislabelled, or all of them in the same way. Single trials of a joint
set are not tried: a recording is one file of a laboratory, and by itself it shows which of its trials disagrees.

Most readings have no parameter (a factor of 9.81, exchanged channels) and win by parsimony. A late or early channel
has a time, a low-passed channel a corner frequency; both are integrated over. The filter is the best one of two orders,
analogue or digital at the sampling rate of the recording. A body file with exchanged segments changes the model instead
of the responses.

Prior: `MISLABELLED`, divided equally among the readings. A share `BESIDE` of each goes to the reading together with an
effect or an unknown cause. Readings far from the nominal model (`FAR`) are not fitted, because `labels` has told them
apart already; those far from any body are fitted loosely only (`mcstudy.lines.reading_fits`). Derived.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mcstudy.effect_library.edits import exchanged_segments, gyrations
from mcstudy.errors import ModelError
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.questions.evidence import Hypothesis, SizeEstimate
from mcstudy.lines.priors import weak_prior
from mcstudy.lines.reading_fits import Along, Relabelled, Search
from mcstudy.lines.readings import ANGLES, READINGS, butterworth
from mcstudy.spectra.lines import Lines
from mcstudy.stance.joint import changed

MISLABELLED = 0.02
"""Prior probability that a recording which passed the check of its labels is mislabelled nevertheless. Assumed: no
survey of laboratory errors is known. A factor of ten changes the log odds by 2.3."""

BESIDE = 0.1
"""Share of it for a mislabelled recording that also has a missing effect: about the prior odds of the latter, with
evidence for a free torque instead of a named one."""

FAR = 6.0
"""Log odds against a reading, from the nominal model, beyond which it is not fitted."""

NEAR = 30.0
"""Readings within this log evidence of the best one are searched from all starts."""

MOST_MISSED = 0.5
"""Largest share of the gain of the best reading that the first search of a better one is assumed to miss. It missed
0.18 in a recording with little noise whose theta1 or theta2 was 20 ms late."""

LEAST_MISSED = 5.0
"""Log evidence that the first search of a reading may miss in any case."""

IMPROBABLE = 5.0
"""Log odds against the best other explanation from which a reading is not searched from all starts."""

CLEAN = 3.0
"""Standard deviations of noise up to which a misfit is one."""

LATE_S = 0.05
"""Standard deviation of the prior on a delay, s: about two frames of slow video."""

LATEST_S = 0.15
"""Longest delay, either sign, s."""

CORNERS_HZ = (1.0, 10.0)
"""Range of the corner of a low-pass; uniform in its logarithm. A corner above is invisible in sway."""

ORDERS = (2, 4)
"""Orders of the Butterworth filter of a low-passed channel, whose corner is at -3 dB (-6 dB without delay)."""

SMALL_TRIALS = (
    *("double", "half", "double_theta1", "half_theta1", "double_theta2", "half_theta2", "kilogram_force", "newton"),
    *("swapped", "sign", "sign_theta1", "sign_theta2", "space_angle", "trunk_frame"),
)
"""Readings that are tried for single trials."""

LEAST_GAIN = 20.0
"""Decrease of the squared difference between trials from which a reading of one trial is fitted. The prior of a reading
costs more than this: twice the log of its odds against no mislabelling."""

MOST_LEFT = 0.1
"""Largest share of the misfit that a reading may leave to another gap. With more, the other gap would be the cause."""


@dataclass(frozen=True)
class Labels:
    """What is known about the labels of a recording.

    Attributes: odds, log odds of readings from the nominal model, a reading without one is fitted; torque, whether the
    stimulus is in N m; accept, codes of readings that the user has checked, which are left out; name, what a recording
    of a joint set is called; parts, the labels of each recording of a joint set; rate_hz, its sampling rate.
    """

    odds: Mapping[str, float]
    torque: bool
    accept: frozenset[str] = frozenset()
    name: str = ""
    parts: tuple[Labels, ...] = ()
    rate_hz: float = np.inf

    @classmethod
    def joined(cls, parts: Sequence[Labels]) -> Labels:
        """The labels of a joint set: what all recordings say of a reading adds up."""
        codes = set.intersection(*(set(p.odds) for p in parts))
        odds = {c: sum(p.odds[c] for p in parts) for c in READINGS if c in codes}
        return cls(odds, all(p.torque for p in parts), parts[0].accept, parts=tuple(parts))

    @property
    def codes(self) -> list[str]:
        """Readings that are possible."""
        return [c for c, r in READINGS.items() if c not in self.accept and (self.torque or not r.torque)]

    @property
    def near(self) -> list[str]:
        """Those that the nominal model does not exclude."""
        return [c for c in self.codes if self.odds.get(c, 0.0) > -FAR]

    def digital(self, lines: Lines) -> np.ndarray:
        """Frequencies (N,) in Hz at which an analogue filter does what a digital one does at the lines.

        The bilinear transform; of a joint set by recording.
        """
        of = self.parts or (self,)
        rate = np.concatenate([np.full(n, own.rate_hz) for own, n in zip(of, lines.counts, strict=True)])
        known = np.isfinite(rate)
        rate = np.where(known, rate, 1.0)
        return np.where(known, np.tan(np.pi * np.where(known, lines.f, 0.0) / rate) * rate / np.pi, lines.f)

    def place(self, one: int | None) -> tuple[str, str]:
        """Ending of a code, and beginning of a sentence, of a reading of ``one`` trial or recording, or of all."""
        if one is None:
            return "", ""
        if self.parts:
            return f"_recording_{one + 1}", f"Recording {one + 1} ({self.parts[one].name}): "
        return f"_trial_{one + 1}", f"Trial {one + 1}: "


@dataclass(frozen=True)
class Mislabelled:
    """A reading of the labels with its evidence, log prior included.

    Attributes
    ----------
    hypothesis
        Its ``effects`` are the code of the reading.
    log_weight
        ln prior probability.
    advice
        What seems to be wrong, and what to check: two sentences.
    """

    hypothesis: Hypothesis
    log_weight: float
    advice: str


@dataclass(frozen=True)
class _Found:
    """One reading after its search; ``again`` repeats it from all starts."""

    code: str
    log_evidence: float
    fitted: Relabelled
    data: Data
    advice: str
    sizes: tuple[SizeEstimate, ...] = ()
    again: Callable[[], _Found | None] | None = None

    @property
    def explains(self) -> bool:
        """Whether it leaves only noise, up to `CLEAN` standard deviations."""
        noise = 4 * self.data.f.size
        return self.fitted.chi2 < noise + CLEAN * np.sqrt(2 * noise)


def mislabelled(
    lines: Lines, base: Fitted, minima: np.ndarray, labels: Labels, seed: int = 0, rival: float = -np.inf
) -> list[Mislabelled]:
    """Readings of a recording that the fit can judge, best first. ``base``, ``minima``: see `Search`.

    ``rival``: log evidence and prior of the best other explanation. Readings that cannot come near it are not searched
    from all starts.
    """
    search = Search(lines, base, minima, seed)
    digital = labels.digital(lines)
    ones = search.trials if len(search.trials) > 1 else ()
    if labels.parts:
        of_one = [(c, k) for k, own in enumerate(labels.parts) for c in own.near]
    else:
        of_one = [(c, k) for k in ones for c in labels.codes if c in SMALL_TRIALS]
    discrete = [*((c, None) for c in labels.near), *of_one]
    searched: list[Callable[[], _Found | None]] = [
        *(partial(_late, search, labels, w, k) for k in (None, *ones) for w in ("", *ANGLES)),
        *(
            partial(_low_passed, search, labels, digital, w, zero, k)
            for k in (None, *ones)
            for w in ("", *ANGLES)
            for zero in (True, False)
        ),
        partial(_exchanged, search, base),
    ]
    far = sum(len(own.codes) - len(own.near) for own in (labels, *labels.parts))
    number = len(discrete) + len(searched) + far
    found = [*_discrete(search, labels, discrete), *(f for f in (each() for each in searched) if f is not None)]
    if not found:
        return []
    weight = float(np.log(MISLABELLED / number))
    found = [_thorough(f) if rivals else f for f, rivals in _leading(found, base.log_evidence, rival - weight)]
    near = max(f.log_evidence for f in found) - NEAR
    close = [f for f in found if f.log_evidence > near]
    out = [_with_another(f, base, weight) for f in close]
    return sorted(out, key=lambda m: -m.hypothesis.log_evidence)


def _leading(found: Sequence[_Found], plain: float, rival: float) -> list[tuple[_Found, bool]]:
    """Readings near the best one; unless that leaves only noise, also those that close most of the gap of the labels.

    Their first fit may not be the best; each with whether a better one could come near ``rival``, the log evidence at
    which a reading is as probable as the best other explanation. ``plain``: log evidence of the labels.
    """
    best = max(found, key=lambda f: f.log_evidence)
    missed = 0.0 if best.explains else MOST_MISSED * (best.log_evidence - plain)
    near = [f for f in found if f.log_evidence > best.log_evidence - max(NEAR, missed)]
    return [(f, f.log_evidence + max(missed, LEAST_MISSED) > rival - IMPROBABLE) for f in near]


def _thorough(found: _Found) -> _Found:
    return (None if found.again is None else _better(found, found.again())) or found


def _with_another(found: _Found, base: Fitted, weight: float) -> Mislabelled:
    """The reading, alone or together with another gap, whose evidence is that of a free torque."""
    body = found.fitted.body
    evidence, noise = found.log_evidence, 4 * found.data.f.size
    if body.chi2 - noise < MOST_LEFT * (base.chi2 - noise):
        scored = Scores(body, found.data, [], [])(body.free_residual(found.data))
        evidence += float(np.logaddexp(np.log(1 - BESIDE), np.log(BESIDE) + scored.unknown[0]))
    return Mislabelled(Hypothesis((found.code,), evidence, found.fitted, found.sizes), weight, found.advice)


def _disagrees(search: Search, labels: Labels, T: np.ndarray) -> np.ndarray:
    """Whether trials agree so much better under T (..., K, N, 2, 2) that a reading of one trial is fitted, (...).

    Recordings under different stimuli have no responses in common, so those of a joint set are always fitted.
    """
    return search.gain(T) >= (-np.inf if labels.parts else LEAST_GAIN)


def _discrete(search: Search, labels: Labels, readings: Sequence[tuple[str, int | None]]) -> list[_Found]:
    """Readings without a parameter that may compete with the labels.

    Each: a code, and a trial or recording, or None for all.
    """
    T = np.array([search.only(READINGS[code].at(search.f), trial) for code, trial in readings])
    of_one = np.array([trial is not None for _, trial in readings])
    kept = np.flatnonzero(~of_one | _disagrees(search, labels, T))
    if not kept.size:
        return []
    return [_without_size(search, labels, readings[k], T[k]) for k in kept[search.promising(T[kept])]]


def _without_size(search: Search, labels: Labels, which: tuple[str, int | None], T: np.ndarray) -> _Found:
    code, trial = which
    reading, (ending, begin) = READINGS[code], labels.place(trial)
    advice = f"{begin}{reading.channel}: seems to be {reading.words}. {reading.remedy}"

    def found(fit: Callable[[np.ndarray], tuple[float, Relabelled, Data]]) -> _Found:
        return _Found(code + ending, *fit(T), advice, again=lambda: found(search.thoroughly))

    return found(search.fit)


def _channels(which: str) -> np.ndarray:
    return np.array([which in ("", angle) for angle in ANGLES])


def _diagonal(search: Search, which: str, factor: np.ndarray, trial: int | None) -> np.ndarray:
    """T (G, K, N, 2, 2) with factors (G, N) on both angles ("") or one, in all trials or one."""
    values = np.where(_channels(which), factor[..., None], 1.0)
    return search.only(values[..., None] * np.eye(2), trial)


def _late(search: Search, labels: Labels, which: str, trial: int | None) -> _Found | None:
    f = search.f
    grid = np.linspace(-LATEST_S, LATEST_S, 21)

    def T(x: np.ndarray) -> np.ndarray:
        return _diagonal(search, which, np.exp(-2j * np.pi * f * x[:, None]), trial)

    if trial is not None and not _disagrees(search, labels, T(grid)).any():
        return None
    end, (ending, begin) = f"_{which}" if which else "", labels.place(trial)

    def told(best: Along | None) -> _Found | None:
        if best is None:
            return None
        x, se = best.x, best.se
        evidence = best.integrated - 0.5 * (x / LATE_S) ** 2 - float(np.log(LATE_S * np.sqrt(2 * np.pi)))
        size = SizeEstimate(f"late{end}{ending}", x, se, x - 1.96 * se, x + 1.96 * se, "s")
        advice = (
            f"{begin}{which or 'theta1, theta2'}: seems to be recorded {1000 * abs(x):.0f} ms "
            f"{'later' if x > 0 else 'earlier'} than the stimulus. "
            "Check the synchronisation of the devices and the delay of their filters."
        )
        step = float(grid[1] - grid[0])
        return _Found(
            f"shifted{end}{ending}",
            evidence,
            best.fitted,
            best.data,
            advice,
            (size,),
            again=lambda: told(search.thoroughly_along(T, x, step)),
        )

    return told(search.along(T, grid))


def _low_passed(
    search: Search, labels: Labels, digital: np.ndarray, which: str, zero_phase: bool, one: int | None
) -> _Found | None:
    low, high = np.log(CORNERS_HZ)
    grid = np.linspace(low, high, 12)
    end, (ending, begin) = f"_{which}" if which else "", labels.place(one)

    def T(x: np.ndarray, order: int = 2, f: np.ndarray = search.f) -> np.ndarray:
        once = butterworth(1j * f / np.exp(x[:, None]), order)
        return _diagonal(search, which, np.abs(once) ** 2 if zero_phase else once, one)

    if one is not None and not _disagrees(search, labels, T(grid)).any():
        return None
    forms = [partial(T, order=order, f=f) for order in ORDERS for f in (search.f, digital)]

    def told(best: Along | None) -> _Found | None:
        if best is None:
            return None
        x, se, corner = best.x, best.se, float(np.exp(best.x))
        low95, high95 = float(np.exp(x - 1.96 * se)), float(np.exp(x + 1.96 * se))
        size = SizeEstimate(f"corner{end}{ending}", corner, corner * se, low95, high95, "Hz")
        advice = (
            f"{begin}{which or 'theta1, theta2'}: seems to be low-passed at {corner:.2g} Hz "
            f"({'without' if zero_phase else 'with'} delay). Give the angles before this filter."
        )
        code = f"{'smoothed' if zero_phase else 'filtered'}{end}{ending}"
        evidence = best.integrated - float(np.log((high - low) * len(forms)))
        return _Found(code, evidence, best.fitted, best.data, advice, (size,), again=lambda: of_any_form(x))

    def of_any_form(x: float) -> _Found | None:
        """The best form of the filter, or the first that leaves only noise, from the corner that one form has."""
        step = float(grid[1] - grid[0])
        best = None
        for form in forms:
            best = _better(best, told(search.thoroughly_along(form, x, step)))
            if best is not None and best.explains:
                break
        return best

    best = None
    for order in ORDERS:
        best = _better(best, told(search.along(partial(T, order=order), grid)))
    return best


def _better(one: _Found | None, other: _Found | None) -> _Found | None:
    return max((f for f in (one, other) if f is not None), key=lambda f: f.log_evidence, default=None)


def _exchanged(search: Search, base: Fitted) -> _Found | None:
    """The body with exchanged segments; the best of the published proportions, which share the prior."""
    fitters = []
    for legs, trunk in gyrations():
        try:
            model = changed(base.model, partial(exchanged_segments, legs_gyration=legs, trunk_gyration=trunk))
        except ModelError:
            continue
        fitter = Fitter(model, weak_prior(model, model), search.f)
        if search.promising(search.same[None], fitter)[0]:
            fitters.append(fitter)
    if not fitters:
        return None

    def best(fit: Callable[[np.ndarray, Fitter], tuple[float, Relabelled, Data]]) -> tuple[float, Relabelled, Data]:
        evidence, fitted, data = max((fit(search.same, fitter) for fitter in fitters), key=lambda f: f[0])
        return evidence - float(np.log(len(gyrations()))), fitted, data

    advice = "body: the segments seem to be exchanged. Segment 1 must be the legs, segment 2 the upper body."

    def found(fit: Callable[[np.ndarray, Fitter], tuple[float, Relabelled, Data]]) -> _Found:
        return _Found("segments", *best(fit), advice, again=lambda: found(search.thoroughly))

    return found(search.fit)
