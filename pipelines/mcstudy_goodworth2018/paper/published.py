"""What Goodworth & Peterka 2018 (J Neurosci Methods 296:44-56) published, as settings and claims.

Nothing here is computed. The statements are in `mcstudy_goodworth2018.paper.statements`, each with its place in the
paper; `mcstudy_goodworth2018.paper.rows` compares each of them with the value from a cube.
"""

from __future__ import annotations

from typing import Any

from mcstudy.analysis.publications.statement import Expectation, Variant

PAPER = "Goodworth & Peterka 2018, J Neurosci Methods 296:44-56"

MARGINS: dict[str, tuple[float, str]] = {
    "bias": (3.0, "percent of the truth; the paper interprets a difference of 3.2 (7.6 and 4.4 %)"),
    "spread": (10.0, "percentage points; the paper distinguishes reductions that differ by 11.6 (21 and 9.4 %)"),
    "ratio": (1 / 12, "half way from 'about half' to a third or two thirds"),
    "sway": (0.015, "degrees; half of the difference between the two angles (0.11 and 0.08)"),
    "starts": (5.0, "'about 20' is nearer to 20 than to 10 or 30"),
}
"""Margins of equivalence by kind of row, and why: a difference within it would not change what the paper concludes."""


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

METHODS: dict[str, tuple[Any, str, str]] = {
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
