"""Stimulus, noise, sway, and the error of a time simulation."""

from __future__ import annotations

from functools import partial

import numpy as np

from mcstudy.report import figures
from mcstudy.report.figure import Figure, Missing, Panel
from mcstudy.report.figures.signals import Signals, cycles
from mcstudy.report.labels import unit
from mcstudy.report.numbers import short
from mcstudy.report.study.context import Context
from mcstudy.text_tables import Table

RECORD = (11.0, 1.9)
"""Size of a record of minutes, inches: the width of the page."""


def signal_figures(context: Context) -> list[Figure | Missing]:
    """The study's own stimulus, noise and truth: the first realization at the smallest amplitude; of a body."""
    view = context.main
    if view.group.model.declared:  # whose angles need not be in degrees
        return []
    s = Signals.of(view, context.seed, float(view.cube["amplitude"].values[0]))
    python = f'figures.NAME(figures.Signals.of(tree["{view.name}"], {context.seed}, {s.amplitude:g}))'
    peak = f"{s.amplitude:g} {unit(view)} ({view.group.stimulus.convention.replace('_', ' ')})"
    stimulus = "Sum of cosines" if view.group.stimulus.lines.harmonic else "Pseudorandom ternary stimulus"
    rms = np.degrees(s.noise_sway).std(axis=0)
    f, error = s.frf_error(view.group.stimulus.discard)
    _, early = s.frf_error(0)
    sampling = s.sampling_error(f)
    angles = "θ1 is the lower body in space, θ2 the joint above it" if len(s.angles) == 2 else "θ1 is the body in space"
    return [
        Figure(
            "noise",
            "Stimulus and sensor noise",
            [
                f"{stimulus} of {peak}, {s.cycles} cycles of {s.periodic.period_s:g} s; sensor noise "
                "that is added to the sensed angles (low-pass filtered pink noise); and the sway that this noise alone "
                "evokes.",
                "RMS of that sway in this realization: "
                + ", ".join(f"{n} {short(rms[i], 2)}°" for i, n in enumerate(s.angles))
                + ".",
            ],
            [
                Panel("stimulus", partial(figures.stimulus_record, s), RECORD),
                Panel("sensor noise", partial(figures.sensor_noise_record, s), RECORD),
                Panel("sway evoked by the noise alone", partial(figures.noise_sway_record, s), RECORD),
            ],
            python=python.replace("NAME", "sensor_noise_record"),
        ),
        Figure(
            "spectra",
            "Power spectra",
            [
                "Left: power of the stimulus at its excited lines (odd harmonics only), falling with the square of "
                "frequency. Right: power of the noise-evoked sway in the mean cycle, as it enters the FRFs (dots), "
                "and its theoretical value (lines). Dots above a line at high frequency are leakage: a cycle of sway "
                "does not end where it began.",
            ],
            [
                Panel("stimulus", partial(figures.stimulus_spectrum, s)),
                Panel("noise-evoked sway", partial(figures.noise_spectrum, s)),
            ],
            python=python.replace("NAME", "noise_spectrum"),
        ),
        Figure(
            "sway",
            "Realistic sway",
            [f"Sway evoked by stimulus and noise together; {angles}."],
            [Panel("sway", partial(figures.sway_record, s), RECORD)],
            python=python.replace("NAME", "sway_record"),
        ),
        Figure(
            "simulation_error",
            "Error of a time simulation",
            [
                "Time integration from rest, without noise, compared with the exact steady state. Left: error of the "
                "sway; the transient decays within the first cycle, and the rest repeats in every cycle. Right: "
                "relative error of the FRFs. It is caused by sampling (crosses): the FRF is divided by the DFT of the "
                "torque's samples, while the body is driven by the torque between them; a torque that is linear "
                "between samples has Fourier coefficients (sin x / x)² times those of its samples, x = π f / rate.",
            ],
            [
                Panel("sway error over time", partial(figures.simulation_error_record, s)),
                Panel("error of the FRFs", partial(figures.simulation_error_frf, s)),
            ],
            [
                Table(
                    f"Relative error of the FRFs at {f[-1]:.2f} Hz",
                    [
                        "angle",
                        "all cycles",
                        f"without the first {cycles(view.group.stimulus.discard)}",
                        "sampling explains",
                    ],
                    [
                        [n, short(early[-1, i]), short(error[-1, i]), short(sampling[-1])]
                        for i, n in enumerate(s.angles)
                    ],
                )
            ],
            python=python.replace("NAME", "simulation_error_frf"),
        ),
    ]
