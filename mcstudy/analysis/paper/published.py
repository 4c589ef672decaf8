"""All numbers of Goodworth & Peterka 2018 (J Neurosci Methods 296:44-56) with which this program is compared.

Each number has its location in the paper. Nothing here is computed; `mcstudy.analysis.paper.rows` compares each entry
of `RESULTS` with the value from a cube.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

PAPER = "Goodworth & Peterka 2018, J Neurosci Methods 296:44-56"

Criterion = Literal["equal", "at most", "above zero", "none"]
"""How a published statement is checked, always within 3 Monte Carlo standard errors of ours.

equal: ours equals the published number. at most: ours is no larger (the paper's number is the residual error of its
solver). above zero: the paper states a ranking; ours is the margin by which it holds, in percent: the distance between
the last parameter that should rank first and the first one that should rank behind. none: stated without a number.
"""


@dataclass(frozen=True)
class Published:
    """One published result.

    Attributes
    ----------
    key: name of the row. label: name in a table. unit: of ``value``.
    value: the number; 0 for a ranking; NaN where the paper states none.
    shown: the statement as printed in a table. where: figure, table or section. criterion: see `Criterion`.
    """

    key: str
    label: str
    unit: str
    value: float
    shown: str
    where: str
    criterion: Criterion = "equal"


BIAS, VARIABILITY, GUESSES, THEORY = (
    "Results, Bias errors",
    "Results, Variability",
    "Results, Multiple initial guesses",
    "Results, Fits without noise",
)

LOWEST_CV = ("K12", "K22", "K21")
HIGHEST_CV = ("B21", "Kpas1", "Kpas2")
LEAST_INFLUENTIAL = ("Kpas1", "Kpas2", "B21")
LARGEST_BIAS = ("Kpas1", "Kpas2", "B21")
BETTER_AT_8HZ = ("Td1", "Td2", "Kpas1", "Kpas2")
WORSE_AT_8HZ = ("K11", "K12", "K21", "K22", "B11", "B12", "B21", "B22")
COMBINED_STIFFNESS = ("K11+Kpas1", "K22+Kpas2")
REDUNDANT = (("K11", "Kpas1"), ("K22", "Kpas2"))
LOW_CV_STIFFNESSES = ("K11", "K12", "K21", "K22")
DELAYS = ("Td1", "Td2")
SMALL_BIAS_PERCENT, LOW_CV = 5.0, 0.2

FMAX_HZ = (0.41, 1.2, 8.0)
AMPLITUDES_NM = (3.0, 5.0)
REALIZATIONS, STARTS = 50, 50
CONVERGENCE_REALIZATIONS, CONVERGENCE_FMAX_HZ = 20, 1.2

_UNORDERED = "no systematic effect"
_ORDER: Criterion = "above zero"
_TABLE, _GUESSES, _FIG3C = f"{BIAS}; Table II", f"{GUESSES}; Fig. 3B", f"{GUESSES}; Fig. 3C"
_FIG7B, _SENSITIVITY, _FIG7C = f"{VARIABILITY}; Fig. 7B", "Results, Sensitivity", "Results, Sensitivity; Fig. 7C"

_RESULTS = (
    Published("theory_mean_error", "no noise, best of 50: mean error", "%", 0.008, "0.008", THEORY, "at most"),
    Published("theory_max_error", "no noise, best of 50: largest error", "%", 0.039, "0.039", THEORY, "at most"),
    Published("theory_cost", "no noise, best of 50: J", "1", 1e-11, "order of 1e-11", f"{THEORY}; Fig. 3A", "at most"),
    Published("bias_12_0.41", "mean |bias|, 12 parameters, 0.41 Hz", "%", 11.6, "11.6", _TABLE),
    Published("bias_12_1.2", "mean |bias|, 12 parameters, 1.2 Hz", "%", 5.8, "5.8", f"{_TABLE}; Fig. 7A"),
    Published("bias_12_8", "mean |bias|, 12 parameters, 8 Hz", "%", 20.0, "20", _TABLE),
    Published("bias_10_0.41", "mean |bias|, stiffness combined (10), 0.41 Hz", "%", 7.6, "7.6", f"Abstract; {_TABLE}"),
    Published("bias_10_1.2", "mean |bias|, stiffness combined (10), 1.2 Hz", "%", 4.4, "4.4", f"Abstract; {_TABLE}"),
    Published("bias_10_8", "mean |bias|, stiffness combined (10), 8 Hz", "%", 11.8, "11.8", _TABLE),
    Published("bias_2_0.41", "mean |bias|, combined stiffnesses (2), 0.41 Hz", "%", 1.3, "1.3", _TABLE),
    Published("bias_2_1.2", "mean |bias|, combined stiffnesses (2), 1.2 Hz", "%", 1.9, "1.9", _TABLE),
    Published("bias_amplitude", "difference of mean |bias|, 3 minus 5 N m", "%", 0.0, _UNORDERED, BIAS),
    Published("largest_bias", "Kpas1, Kpas2, B21 are most biased, 1.2 Hz", "%", 0.0, "> 0", _SENSITIVITY, _ORDER),
    Published("spread_fmax", "SD reduction from 0.41 to 1.2 Hz, 12", "%", 10.0, "10", f"{VARIABILITY}; Fig. 5"),
    Published("spread_fmax_10", "SD reduction from 0.41 to 1.2 Hz, combined (10)", "%", 41.0, "41", VARIABILITY),
    Published("spread_fmax_2", 'the same, "combined" read as the sums (2)', "%", 41.0, "41", f"{VARIABILITY}; Fig. 6"),
    Published("spread_amplitude_0.41", "SD reduction from 3 to 5 N m, 0.41 Hz", "%", 38.0, "38", VARIABILITY),
    Published("spread_amplitude_1.2", "SD reduction from 3 to 5 N m, 1.2 Hz", "%", 21.0, "21", VARIABILITY),
    Published("spread_amplitude_8", "SD reduction from 3 to 5 N m, 8 Hz", "%", 9.4, "9.4", VARIABILITY),
    Published("spread_8hz_better", "delays, Kpas: SD reduction from 1.2 to 8 Hz", "%", 0.0, "> 0", VARIABILITY, _ORDER),
    Published("spread_8hz_worse", "the others: SD reduction from 8 to 1.2 Hz", "%", 0.0, "> 0", VARIABILITY, _ORDER),
    Published("lowest_cv", "K12, K22, K21 have the lowest CV, 1.2 Hz", "%", 0.0, "> 0", _FIG7B, _ORDER),
    Published("highest_cv", "B21, Kpas1, Kpas2 have the highest CV, 1.2 Hz", "%", 0.0, "> 0", _FIG7B, _ORDER),
    Published("combined_cv_lowest", "sums of stiffnesses have the lowest CV of all", "%", 0.0, "> 0", _FIG7B, _ORDER),
    Published("combined_cv_ratio", "CV of K11+Kpas1, K22+Kpas2 over K11's, K22's", "1", 0.5, "about 0.5", VARIABILITY),
    Published("least_influential", "Kpas1, Kpas2, B21 are least influential", "%", 0.0, "> 0", _FIG7C, _ORDER),
    Published("unstable_8", "unstable best fits at 8 Hz", "%", float("nan"), "not unusual", _FIG3C, "none"),
    Published("starts_noise_free", "starts to the asymptote, no noise", "starts", 20.0, "about 20", _GUESSES),
    Published("starts_5", "starts to the asymptote, 5 N m", "starts", 20.0, "about 20", _GUESSES),
    Published("starts_3", "starts to the asymptote, 3 N m", "starts", 20.0, "about 20", _GUESSES),
)  # fmt: skip

RESULTS: dict[str, Published] = {p.key: p for p in _RESULTS}
"""Published results by key, in the order of the paper."""


@dataclass(frozen=True)
class Expectation:
    """Direction implied by a claim: a measure of `mcstudy.analysis.compare` rises (+1) or falls (-1) at these Fmax."""

    measure: str
    sign: int
    fmax: tuple[float, ...]


@dataclass(frozen=True)
class Variant:
    """A published claim about a changed setting; the paper gives no number.

    ``changes``: settings that differ from the paper's own, as fields of a study file. ``expects``: the claim in terms
    of our measures. The paper's "improved fits" is read as estimates closer to the truth and fewer unstable ones; a
    lower cost cannot be meant, because tighter bounds can only raise the minimum.
    """

    study: str
    changes: tuple[str, ...]
    claim: str
    where: str
    expects: tuple[Expectation, ...]


_CONSIDERATIONS = "Discussion, Parameter estimation considerations"
VARIANTS = (
    Variant(
        "lower_bound_half",
        ("model.bounds.lower = 0.5",),
        "lower bounds at half the truth improve fits to 1.2 and 8 Hz",
        _CONSIDERATIONS,
        (Expectation("rmse", -1, (1.2, 8.0)), Expectation("unstable", -1, (1.2, 8.0))),
    ),
    Variant(
        "no_averaging_exception",
        ("spectra.points = averaged",),
        "averaging 0.435-0.526 Hz too: more bias, less variance of FRFs",
        _CONSIDERATIONS,
        (Expectation("bias", 1, (1.2, 8.0)), Expectation("frf_spread", -1, (1.2, 8.0))),
    ),
    Variant(
        "without_8hz",
        ("spectra.exclude_hz = [8.0]",),
        "leaving out the 8 Hz point: more often stable, closer to the truth",
        GUESSES,
        (Expectation("unstable", -1, (8.0,)), Expectation("rmse", -1, (8.0,))),
    ),
)
"""Claims that other pipelines test."""

METHODS: dict[str, tuple[object, str, str]] = {
    "torque amplitudes": (AMPLITUDES_NM, "N m", "Methods: peak-to-peak; caption of Fig. 2: peak"),
    "cycle": (43.72, "s", "Methods, Simulations with sensor noise"),
    "record": (262.32, "s", "Methods, Simulations with sensor noise"),
    "cycles averaged": (5, "1", "Methods, Simulations with sensor noise"),
    "sampling rate": (200.0, "Hz", "Methods, Simulations with sensor noise"),
    "stimulus bandwidth": ((0.023, 16.7), "Hz", "Methods, Simulations with sensor noise"),
    "sensor noise PSD at 0.5 Hz": ((4e-4, 7e-5), "deg^2/Hz", "Methods, Simulations with sensor noise"),
    "noise low-pass": (0.15, "Hz", "Methods, Simulations with sensor noise"),
    "noise-evoked sway RMS": ((0.11, 0.08), "deg", "Methods, Simulations with sensor noise"),
    "bounds of gains": ((0.0, 2.0), "of the truth", "Methods"),
    "bounds of delays": (0.030, "s either side", "Methods"),
    "solver resolution": (1e-16, "1", "Methods"),
    "frequency points": (28, "1", "Methods"),
    "sensitivity change": (0.10, "of the truth", "Methods, Sensitivity"),
    "influential parameters' CV": (0.2, "1", "Results, Sensitivity: below this they are among the most influential"),
}
"""Settings that the paper states: (value, unit, location). The study file contains them; this is a reference list."""
