"""The paper's statements about estimates, as functions of the best fits of a study: Table II, Fig. 5-7B.

Every function takes `Measures` (12 parameters and the two sums of stiffnesses) and averages over the paper's
amplitudes, as the paper does. Percent means percent of the true value, or of the number compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.analysis.publications.sampling import Means
from mcstudy_goodworth2018.paper import published
from mcstudy_goodworth2018.paper.published import FMAX_HZ
from mcstudy_goodworth2018.paper.ranks import ranks

LOW, MID, HIGH = FMAX_HZ
WEAK, STRONG = range(len(published.AMPLITUDES_NM))
TWO = published.COMBINED_STIFFNESS
TWELVE = (*published.BETTER_AT_8HZ, *published.WORSE_AT_8HZ)
TEN = (*TWO, *(n for n in TWELVE if n not in ("K11", "Kpas1", "K22", "Kpas2")))
NAMES = (*TWELVE, *TWO)
PASSIVE, DAMPINGS = ("Kpas1", "Kpas2"), ("B11", "B12", "B21", "B22")
STIFFNESSES = published.LOW_CV_STIFFNESSES
_AT = {name: i for i, name in enumerate(NAMES)}


@dataclass(frozen=True)
class Measures:
    """|bias|, standard deviation (percent of the truth) and CV, each (..., amplitude, fmax, `NAMES`).

    ``fmax``: Hz, of that axis; the amplitudes are 3 and 5 N m.
    """

    bias: np.ndarray
    sd: np.ndarray
    cv: np.ndarray
    fmax: tuple[float, ...]

    def of(self, what: str, names: Iterable[str], fmax: float, amplitude: int | None = None) -> np.ndarray:
        """A measure of each of the parameters, mean over both amplitudes or at one of them."""
        x = getattr(self, what)[..., self.fmax.index(fmax), :][..., [_AT[n] for n in names]]
        found: np.ndarray = x.mean(-2) if amplitude is None else x[..., amplitude, :]
        return found


def measures(m: Means, truth: np.ndarray, fmax: Sequence[float]) -> Measures:
    """`Measures` of moments whose last axes are (amplitude, fmax, `NAMES`), with the true values (names,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        bias, sd = 100 * abs(m.mean - truth) / abs(truth), 100 * m.sd / abs(truth)
        return Measures(bias, sd, m.sd / abs(m.mean), tuple(fmax))


Statistic = Callable[[Measures], np.ndarray]
Statistics = dict[str, Statistic]
OfMeans = Callable[[Means], np.ndarray]


def mean(what: str, names: Iterable[str], fmax: float, amplitude: int | None = None) -> Statistic:
    """Mean over parameters, and over both amplitudes unless one is given."""
    return lambda m: m.of(what, names, fmax, amplitude).mean(-1)


def each(what: str, names: Iterable[str], fmax: float) -> Statistic:
    """Each parameter, mean over both amplitudes: (..., names)."""
    return lambda m: m.of(what, names, fmax)


def reduction(before: Statistic, after: Statistic) -> Statistic:
    """By how much the second is smaller than the first, percent of the first."""
    return lambda m: 100 * (1 - after(m) / before(m))


def excess(larger: Statistic, smaller: Statistic) -> Statistic:
    """By how much the first is larger than the second, percent of the second."""
    return lambda m: 100 * (larger(m) / smaller(m) - 1)


def least(*statistics: Statistic) -> Statistic:
    """The smallest of several numbers."""
    return lambda m: np.min([s(m) for s in statistics], axis=0)


def most(*statistics: Statistic) -> Statistic:
    """The largest of several numbers."""
    return lambda m: np.max([s(m) for s in statistics], axis=0)


def least_parameter(of: Statistic) -> Statistic:
    """The smallest over parameters."""
    return lambda m: of(m).min(-1)


def lead(x: np.ndarray, names: Sequence[str], first: Iterable[str], largest: bool) -> np.ndarray:
    """Margin in percent by which the worst of ``first`` ranks ahead of the best other parameter (larger or smaller).

    ``x``: (..., names).
    """
    chosen = np.isin(np.array(names), list(first))
    inside, outside = x[..., chosen], x[..., ~chosen]
    if largest:
        return np.asarray(100 * (inside.min(-1) / outside.max(-1) - 1))
    return np.asarray(100 * (outside.min(-1) / inside.max(-1) - 1))


def ranked(what: str, first: Iterable[str], largest: bool, names: Sequence[str] = TWELVE) -> Statistic:
    """`lead` of parameters at 1.2 Hz."""
    return lambda m: lead(m.of(what, names, MID), names, first, largest)


def _of_passive(what: str) -> Statistic:
    """Smallest excess, over the Fmax, of the passive stiffnesses over the other parameters (means)."""
    others = tuple(n for n in TWELVE if n not in PASSIVE)
    return least(*(excess(mean(what, PASSIVE, f), mean(what, others, f)) for f in FMAX_HZ))


def _difference_of_bias(m: Measures) -> np.ndarray:
    weak, strong = (np.mean([mean("bias", TWELVE, f, a)(m) for f in FMAX_HZ], axis=0) for a in (WEAK, STRONG))
    return np.asarray(weak - strong)


def _over_fmax(what: str, names: Iterable[str]) -> Statistic:
    return reduction(mean(what, names, LOW), mean(what, names, MID))


def _over_amplitude(what: str, fmax: float) -> Statistic:
    return reduction(mean(what, TWELVE, fmax, WEAK), mean(what, TWELVE, fmax, STRONG))


_BETTER, _WORSE = published.BETTER_AT_8HZ, published.WORSE_AT_8HZ

SMOOTH: dict[str, tuple[tuple[float, ...], Statistic]] = {
    **{f"bias_12_{f:g}": ((f,), mean("bias", TWELVE, f)) for f in FMAX_HZ},
    **{f"bias_10_{f:g}": ((f,), mean("bias", TEN, f)) for f in FMAX_HZ},
    **{f"bias_2_{f:g}": ((f,), mean("bias", TWO, f)) for f in (LOW, MID)},
    "bias_amplitude": (FMAX_HZ, _difference_of_bias),
    "bias_8_largest": (
        FMAX_HZ,
        excess(mean("bias", TWELVE, HIGH), most(mean("bias", TWELVE, LOW), mean("bias", TWELVE, MID))),
    ),
    "bias_passive": (FMAX_HZ, _of_passive("bias")),
    "largest_bias": ((MID,), ranked("bias", published.LARGEST_BIAS, largest=True)),
    "spread_fmax": ((LOW, MID), _over_fmax("sd", TWELVE)),
    "spread_fmax_cv": ((LOW, MID), _over_fmax("cv", TWELVE)),
    "spread_fmax_10": ((LOW, MID), _over_fmax("sd", TEN)),
    "spread_fmax_2": ((LOW, MID), _over_fmax("sd", TWO)),
    "spread_8_larger": ((MID, HIGH), excess(mean("sd", TWELVE, HIGH), mean("sd", TWELVE, MID))),
    "spread_8hz_better": ((MID, HIGH), reduction(mean("sd", _BETTER, MID), mean("sd", _BETTER, HIGH))),
    "spread_8hz_better_each": (
        (MID, HIGH),
        least_parameter(reduction(each("sd", _BETTER, MID), each("sd", _BETTER, HIGH))),
    ),
    "spread_8hz_worse": ((MID, HIGH), reduction(mean("sd", _WORSE, HIGH), mean("sd", _WORSE, MID))),
    "spread_8hz_worse_each": (
        (MID, HIGH),
        least_parameter(reduction(each("sd", _WORSE, HIGH), each("sd", _WORSE, MID))),
    ),
    "spread_passive": (FMAX_HZ, _of_passive("sd")),
    "spread_sums": (FMAX_HZ, least(*(excess(mean("sd", TWELVE, f), mean("sd", TWO, f)) for f in FMAX_HZ))),
    **{f"spread_amplitude_{f:g}": ((f,), _over_amplitude("sd", f)) for f in FMAX_HZ},
    **{f"spread_amplitude_cv_{f:g}": ((f,), _over_amplitude("cv", f)) for f in FMAX_HZ},
    "lowest_cv": ((MID,), ranked("cv", published.LOWEST_CV, largest=False)),
    "highest_cv": ((MID,), ranked("cv", published.HIGHEST_CV, largest=True)),
    "low_cv": ((MID,), lambda m: m.of("cv", STIFFNESSES, MID).max(-1)),
    "cv_stiffness_damping": ((MID,), excess(mean("cv", DAMPINGS, MID), mean("cv", STIFFNESSES, MID))),
    "cv_stiffness_damping_each": ((MID,), ranked("cv", STIFFNESSES, False, (*STIFFNESSES, *DAMPINGS))),
    "combined_cv_lowest": ((MID,), ranked("cv", TWO, False, NAMES)),
    "combined_cv_ratio": ((MID,), lambda m: (m.of("cv", TWO, MID) / m.of("cv", ("K11", "K22"), MID)).mean(-1)),
}
"""Smooth statistics of the moments: (the Fmax they need, the function)."""

RANKINGS: dict[str, tuple[str, tuple[str, ...], int, bool]] = {
    "largest_bias": ("bias", TWELVE, 4, True),
    "lowest_cv": ("cv", TWELVE, 4, False),
    "highest_cv": ("cv", TWELVE, 4, True),
    "low_cv": ("cv", STIFFNESSES, 4, True),
    "combined_cv_lowest": ("cv", NAMES, 3, False),
}
"""Rows that print the parameters behind a ranking at 1.2 Hz: measure, parameters, how many, largest first."""


def leaders(x: np.ndarray, names: Sequence[str], n: int, largest: bool) -> str:
    """The first ``n`` of a ranking of ``x`` (names,) as text."""
    order = np.argsort(-x if largest else x, kind="stable")[:n]
    return ", ".join(f"{names[i]} {x[i]:.3g}" for i in order)


def _small_bias(names: Iterable[str], fmax: float) -> Statistic:
    def of(m: Measures) -> np.ndarray:
        x = m.of("bias", names, fmax)
        return np.asarray(np.where(np.isfinite(x).all(-1), 100 * (x < published.SMALL_BIAS_PERCENT).mean(-1), np.nan))

    return of


COUNTED: dict[str, tuple[tuple[float, ...], Statistic]] = {
    f"bias_below_5_{len(names)}_{f:g}": ((f,), _small_bias(names, f)) for names in (TWELVE, TEN) for f in (LOW, MID)
}
"""Counts that need the best fits only: percent of the parameters whose |bias| is below 5 %."""


def by_influence(influence: np.ndarray, mostly_high: np.ndarray) -> dict[str, Statistic]:
    """Counts and ranks at 1.2 Hz that need the sensitivity, both (`TWELVE`,).

    ``influence``: of each parameter; the three smallest count as of small influence. ``mostly_high``: whether it is
    largest at high frequencies.
    """
    rank = ranks(influence)
    either = (rank <= len(published.LEAST_INFLUENTIAL)) | mostly_high
    upper = rank > len(TWELVE) / 2

    def share(of: np.ndarray, x: np.ndarray, among: np.ndarray) -> np.ndarray:
        """Percent; 100 where there is none among which to count: the statement then has no exception."""
        total = among.sum(-1)
        percent = np.where(total > 0, 100 * (of & among).sum(-1) / np.maximum(total, 1), 100.0)
        return np.asarray(np.where(np.isfinite(x).all(-1), percent, np.nan))

    def explained(m: Measures) -> np.ndarray:
        x = m.of("bias", TWELVE, MID)
        return share(either, x, x > published.SMALL_BIAS_PERCENT)

    def influential(m: Measures) -> np.ndarray:
        x = m.of("cv", TWELVE, MID)
        return share(upper, x, x < published.LOW_CV)

    def follows(what: str) -> Statistic:
        centred = rank - rank.mean()
        scale = np.sqrt((centred**2).sum())

        def of(m: Measures) -> np.ndarray:
            own = ranks(m.of(what, TWELVE, MID))
            own = own - own.mean(-1, keepdims=True)
            return np.asarray(-(own * centred).sum(-1) / (scale * np.sqrt((own**2).sum(-1))))

        return of

    return {
        "bias_over_5": explained,
        "low_cv_influential": influential,
        "influence_cv": follows("cv"),
        "influence_bias": follows("bias"),
    }


def weaker_with_noise(r: np.ndarray) -> np.ndarray:
    """By how much a correlation (..., amplitude, fmax) is smaller at the small amplitude, mean over 1.2 and 8 Hz."""
    at = [FMAX_HZ.index(MID), FMAX_HZ.index(HIGH)]
    return np.asarray((r[..., STRONG, :] - r[..., WEAK, :])[..., at].mean(-1))


def weaker_at_8hz(r: np.ndarray) -> np.ndarray:
    """By how much a correlation (..., amplitude, fmax) is smaller at 8 than at 1.2 Hz, mean over amplitudes."""
    return np.asarray((r[..., FMAX_HZ.index(MID)] - r[..., FMAX_HZ.index(HIGH)]).mean(-1))
