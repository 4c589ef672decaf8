"""Every number and ranking in the text of Goodworth & Peterka 2018, each with its place: the rows of a comparison.

A statement that can be read in two ways is two rows, the second marked "(reading)". Words without a number are read as
written beside them here: "typically" and "in general" as more than half, "not always" as more than 1 in 100,
"essentially no influence" as less than 1 % of the pie, "large influence" as more than an equal share of it.
"""

from __future__ import annotations

from mcstudy.analysis.publications.statement import Published
from mcstudy_goodworth2018.paper.published import (
    AMPLITUDES_NM,
    BIAS,
    CONVERGENCE_REALIZATIONS,
    GUESSES,
    LOW_CV,
    MARGINS,
    THEORY,
    VARIABILITY,
)

_TABLE, _FIG3A, _FIG3B, _FIG3C = (f"{BIAS}; Table II", *(f"{GUESSES}; Fig. 3{x}" for x in "ABC"))
_FIG5, _FIG6, _FIG7B = (f"{VARIABILITY}; Fig. {x}" for x in ("5", "6", "7B"))
_SENSITIVITY, _DISCUSSION = "Results, Sensitivity", "Discussion, first paragraph"
_FIG7A, _FIG7C = f"{_SENSITIVITY}; Fig. 7A", f"{_SENSITIVITY}; Fig. 7C"
_ESTIMATES = "Results, Parameters estimates with sensor noise; Fig. 5"
_NOISE = "Methods, Simulations with sensor noise"


def _bias(key: str, label: str, value: float, digits: int, where: str = _TABLE) -> Published:
    return Published(
        key, label, "%", value, f"{value:g}", where, half_unit=0.5 * 10.0**-digits, margin=MARGINS["bias"][0]
    )


def _spread(key: str, label: str, value: float, where: str, half_unit: float = 0.5) -> Published:
    return Published(key, label, "%", value, f"{value:g}", where, half_unit=half_unit, margin=MARGINS["spread"][0])


def _holds(key: str, label: str, where: str, unit: str = "%", n: int = 50) -> Published:
    """A ranking: ours is the margin by which it holds."""
    return Published(key, label, unit, 0.0, "> 0", where, "at least", n=n)


def _majority(key: str, label: str, where: str) -> Published:
    """'Typically' or 'in general': more than half."""
    return Published(key, label, "%", 50.0, "> 50", where, "at least")


def _unstated(key: str, label: str, shown: str, where: str) -> Published:
    return Published(key, label, "%", float("nan"), shown, where, "none")


def _sway(key: str, label: str, value: float) -> Published:
    return Published(
        key, label, "deg", value, f"about {value:g}", _NOISE, half_unit=0.005, margin=MARGINS["sway"][0], n=0
    )


def _starts(key: str, label: str, n: int) -> Published:
    return Published(key, label, "starts", 20.0, "about 20", _FIG3B, margin=MARGINS["starts"][0], n=n)


def _residual(key: str, label: str, value: float, shown: str, half_unit: float, unit: str = "%") -> Published:
    """What is left without noise: the error of the solver, so that ours may be smaller."""
    return Published(key, label, unit, value, shown, THEORY, "at most", half_unit, n=1)


_THEORY = (
    _residual("theory_mean_error", "no noise, best of 50: mean error", 0.008, "about 0.008", 0.0005),
    _residual("theory_max_error", "no noise, best of 50: largest error", 0.039, "0.039", 0.0005),
    _holds("theory_worst", "no noise: Kpas2 has the largest error", THEORY, n=1),
    _residual("theory_cost", "no noise, best of 50: J", 1e-11, "order of 1e-11", 2.2e-11, "1"),
    Published("theory_misses", "no noise: starts that miss the minimum", "%", 1.0, "not always 0", _FIG3A, "at least",
              n=1),
    Published("theory_relation", "no noise: r of log J and log J_NC, starts", "1", 0.9, "nearly linear", _FIG3A,
              "at least", n=1),
)  # fmt: skip

_BIAS = (
    _bias("bias_12_0.41", "mean |bias|, 12 parameters, 0.41 Hz", 11.6, 1),
    _bias("bias_12_1.2", "mean |bias|, 12 parameters, 1.2 Hz", 5.8, 1, f"{_TABLE}, Fig. 7A"),
    _bias("bias_12_8", "mean |bias|, 12 parameters, 8 Hz", 20.0, 0),
    _bias("bias_10_0.41", "mean |bias|, stiffness combined (10), 0.41 Hz", 7.6, 1, f"Abstract; {_TABLE}"),
    _bias("bias_10_1.2", "mean |bias|, stiffness combined (10), 1.2 Hz", 4.4, 1, f"Abstract; {_TABLE}"),
    _bias("bias_10_8", "mean |bias|, stiffness combined (10), 8 Hz", 11.8, 1),
    _bias("bias_2_0.41", "mean |bias|, combined stiffness (2), 0.41 Hz", 1.3, 1),
    _bias("bias_2_1.2", "mean |bias|, combined stiffness (2), 1.2 Hz", 1.9, 1),
    Published("bias_amplitude", "mean |bias|, 3 minus 5 N m", "%", 0.0, "no effect", BIAS, margin=MARGINS["bias"][0]),
    _holds("bias_8_largest", "mean |bias| is largest at 8 Hz", BIAS),
    _majority("bias_below_5_12_0.41", "|bias| below 5 %: of 12, 0.41 Hz", _DISCUSSION),
    _majority("bias_below_5_12_1.2", "|bias| below 5 %: of 12, 1.2 Hz", _DISCUSSION),
    _majority("bias_below_5_10_0.41", "|bias| below 5 %: of 10, 0.41 Hz (reading)", _DISCUSSION),
    _majority("bias_below_5_10_1.2", "|bias| below 5 %: of 10, 1.2 Hz (reading)", _DISCUSSION),
    _holds("bias_passive", "Kpas are more biased than the rest, each Fmax", f"{BIAS}; Fig. 7A"),
    _holds("largest_bias", "Kpas1, Kpas2, B21 are most biased, 1.2 Hz", _FIG7A),
    _majority("bias_over_5", "|bias| over 5 %: weak or high-frequency", _FIG7A),
)

_SPREAD = (
    _spread("spread_fmax", "SD reduction from 0.41 to 1.2 Hz, 12", 10.0, _FIG5),
    _spread("spread_fmax_cv", "CV reduction from 0.41 to 1.2 Hz (reading)", 10.0, _FIG5),
    _spread("spread_fmax_10", "SD reduction from 0.41 to 1.2 Hz, 10 combined", 41.0, VARIABILITY),
    _spread("spread_fmax_2", "SD reduction, 0.41 to 1.2 Hz, sums (reading)", 41.0, _FIG6),
    _holds("spread_8_larger", "mean SD at 8 Hz above that at 1.2 Hz", f"Abstract; {VARIABILITY}"),
    _holds("spread_8hz_better", "delays, Kpas: mean SD falls from 1.2 to 8 Hz", VARIABILITY),
    _holds("spread_8hz_better_each", "delays, Kpas: each SD falls (reading)", VARIABILITY),
    _holds("spread_8hz_worse", "the others: mean SD falls from 8 to 1.2 Hz", VARIABILITY),
    _holds("spread_8hz_worse_each", "the others: each SD falls (reading)", VARIABILITY),
    _holds("spread_passive", "Kpas scatter more than the rest, each Fmax", f"{BIAS}; Fig. 7B"),
    _holds("spread_sums", "sums of stiffnesses scatter less, each Fmax", _FIG6),
    _spread("spread_amplitude_0.41", "SD reduction from 3 to 5 N m, 0.41 Hz", 38.0, VARIABILITY),
    _spread("spread_amplitude_1.2", "SD reduction from 3 to 5 N m, 1.2 Hz", 21.0, VARIABILITY),
    _spread("spread_amplitude_8", "SD reduction from 3 to 5 N m, 8 Hz", 9.4, VARIABILITY, 0.05),
    _spread("spread_amplitude_cv_0.41", "CV reduction, 3 to 5 N m, 0.41 Hz (reading)", 38.0, VARIABILITY),
    _spread("spread_amplitude_cv_1.2", "CV reduction, 3 to 5 N m, 1.2 Hz (reading)", 21.0, VARIABILITY),
    _spread("spread_amplitude_cv_8", "CV reduction, 3 to 5 N m, 8 Hz (reading)", 9.4, VARIABILITY, 0.05),
    Published("together_1", "K11, Kpas1 trade off: r of estimates", "1", 0.0, "< 0", _ESTIMATES, "at most"),
    Published("together_2", "K22, Kpas2 trade off: r of estimates", "1", 0.0, "< 0", _ESTIMATES, "at most"),
)

_CV = (
    _holds("lowest_cv", "K12, K22, K21 have the lowest CV, 1.2 Hz", _FIG7B),
    _holds("highest_cv", "B21, Kpas1, Kpas2 have the highest CV, 1.2 Hz", _FIG7B),
    _holds("combined_cv_lowest", "sums of stiffnesses have the lowest CV of all", _FIG7B),
    Published("combined_cv_ratio", "CV of K11+Kpas1, K22+Kpas2 over K11's, K22's", "1", 0.5, "about half", _FIG7B,
              margin=MARGINS["ratio"][0]),
    Published("low_cv", "largest CV of K11, K12, K21, K22, 1.2 Hz", "1", LOW_CV, "< 0.2", _FIG7B, "at most"),
    _holds("cv_stiffness_damping", "mean CV: dampings above these stiffnesses", _FIG7B),
    _holds("cv_stiffness_damping_each", "each damping's CV above each (reading)", _FIG7B),
    _majority("low_cv_influential", "CV < 0.2: among the 6 most influential", _FIG7C),
    _holds("influence_cv", "influence and low CV: rank correlation", f"Abstract; {_SENSITIVITY}", "1"),
    _holds("influence_bias", "influence and low |bias|: rank correlation", _DISCUSSION, "1"),
)  # fmt: skip

_MODEL = (
    _holds("least_influential", "Kpas1, Kpas2, B21 are least influential", _FIG7C, n=0),
    Published("delays_low", "delays: larger share at low frequencies", "%", 1.0, "almost none", _FIG7C, "at most", n=0),
    Published("delays_high", "delays: smaller share at high frequencies", "%", 100 / 12, "large (> 8.3)", _FIG7C,
              "at least", n=0),
    _holds("delays_most_high", "delays: share at high minus below (reading)", _FIG7C, n=0),
    _holds("stiffness_low", "K11, K12, K21, K22: share at low minus high", _FIG7C, n=0),
    _holds("damping_high", "dampings: share at high minus low", _FIG7C, n=0),
    _sway("sway_1", "noise sway RMS, theta1, whole record", 0.11),
    _sway("sway_1_cycle", "noise sway RMS, theta1, one cycle (reading)", 0.11),
    _sway("sway_2", "noise sway RMS, theta2, whole record", 0.08),
    _sway("sway_2_cycle", "noise sway RMS, theta2, one cycle (reading)", 0.08),
)  # fmt: skip

_FITS = (
    _unstated("unstable_8", "unstable best fits, 8 Hz", "not unusual", _FIG3C),
    _unstated("unstable_1.2", "unstable best fits, 1.2 Hz", "not mentioned", _FIG3C),
    _unstated("unstable_0.41", "unstable best fits, 0.41 Hz", "not mentioned", _FIG3C),
    _holds("unstable_8_most", "unstable best fits: 8 Hz minus the others", _FIG3C),
    _holds("relation_noise_starts", "r(J, J_NC) weaker at 3 than 5 N m: starts", _FIG3C, "1"),
    _holds("relation_noise_best", "the same over best fits (reading)", _FIG3C, "1"),
    _holds("relation_8hz_starts", "r(J, J_NC) weaker at 8 than 1.2 Hz: starts", _FIG3C, "1"),
    _holds("relation_8hz_best", "the same over best fits, 8 Hz (reading)", _FIG3C, "1"),
    _unstated("misses", "starts that miss the minimum, 1.2 Hz", "frequent", "Discussion, Parameter estimation"),
    _holds("cost_order", "lowest J: 3 above 5 N m, 1.2 Hz", _FIG3B, n=CONVERGENCE_REALIZATIONS),
    _starts("starts_noise_free", "starts to the asymptote, no noise", 5),
    *(_starts(f"starts_{a:g}", f"starts to the asymptote, {a:g} N m", CONVERGENCE_REALIZATIONS)
      for a in reversed(AMPLITUDES_NM)),
)  # fmt: skip

RESULTS: dict[str, Published] = {p.key: p for p in (*_THEORY, *_BIAS, *_SPREAD, *_CV, *_MODEL, *_FITS)}
"""Published statements by key, by subject."""
