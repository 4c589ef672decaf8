"""One configuration: the paper's study at given true values and choices, reduced to moments of its estimates.

The study is that of the paper: 50 noise realizations, three Fmax, two torques. Simulation and fits are the package's
own (`mcstudy.study.experiment`). Each fit starts from one linearised start, which finds the minimum that 50 random
starts find in 96 to 100 % of realizations at the stand-in (50 of each cell); an early end is 50 random starts of
`EARLY` evaluations each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.analysis.sensitivity import influence
from mcstudy.fitting.linearised import linearised_many
from mcstudy.fitting.solvers import Options, fit_many
from mcstudy.fitting.starts import uniform
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SensorNoise, record_frequencies
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stance.stability import growth_rate
from mcstudy.streams import start_stream
from mcstudy.study.design import (
    FitSection,
    Group,
    ModelSection,
    NoiseSection,
    SpectraSection,
    StimulusSection,
    Study,
    StudySection,
)
from mcstudy.study.experiment import Experiment
from mcstudy_goodworth2018.lost_table.unknowns import CONVENTIONS, DELAYS, GAINS, SLOWEST, SOLVERS, WIDTHS
from mcstudy_goodworth2018.paper.published import AMPLITUDES_NM, FMAX_HZ

EARLY = 12
"""Evaluations of the model with its derivatives after which an early end stops a fit."""

EARLY_STARTS = 50
PARAMETERS = (*GAINS, *DELAYS)
PSD = (4e-4, 7e-5)
"""Density of the sensor noise at 0.5 Hz, deg^2/Hz (Goodworth & Peterka 2018, Methods)."""

COMBINED = (("K11", "Kpas1"), ("K22", "Kpas2"))
CYCLE_S, CYCLES, RATE_HZ = 43.72, 6, 200.0


@dataclass(frozen=True)
class Moments:
    """Moments of the estimates of one study, relative to the true values; leading dims may stand before all.

    Attributes
    ----------
    bias: mean estimate minus truth over truth, (3 Fmax, 2 torques, 14): 12 parameters, then the two sums.
    spread: standard deviation over truth, the same shape.
    sway: RMS of noise-evoked sway in deg, (2 spans, 2 angles); exact.
    influence: J_true after a change of 10 %, (12,), in the order of `PARAMETERS`; exact.
    """

    bias: np.ndarray
    spread: np.ndarray
    sway: np.ndarray
    influence: np.ndarray


def damped(values: np.ndarray, chunk: int = 4096) -> np.ndarray:
    """Whether the closed loops of ``values`` (N, U) are stable with every mode faster than `SLOWEST`, (N,) bool."""
    model = two_segment()
    order = [PARAMETERS.index(name) for name in model.names]
    theta = values[:, order]
    parts = [growth_rate(model, theta[k : k + chunk]) for k in range(0, len(theta), chunk)]
    return np.asarray(np.concatenate(parts) < -SLOWEST) if parts else np.zeros(0, dtype=bool)


def study_of(values: np.ndarray, seed: int, realizations: int, starts: int = 1) -> Study:
    """The study of one configuration ``values`` (U,)."""
    named = dict(zip((*PARAMETERS, "noise", "convention", "width", "sway_over", "solver"), values, strict=True))
    group = Group(
        realizations=realizations,
        starts=starts,
        fmax=list(FMAX_HZ),
        amplitude=list(AMPLITUDES_NM),
        model=ModelSection(truth={name: float(named[name]) for name in PARAMETERS}),
        stimulus=StimulusSection(convention=CONVENTIONS[int(named["convention"])]),
        noise=NoiseSection(psd=[float(named["noise"]) * p for p in PSD]),
        spectra=SpectraSection(width=WIDTHS[int(named["width"])]),
        fit=FitSection(starts="linearised"),
    )
    return Study(study=StudySection(name="table_one", seed=seed), group={"accuracy": group})


def simulate(values: np.ndarray, seed: int, realizations: int) -> Moments:
    """Moments of the study at ``values`` (U,); a pure function of its arguments."""
    study = study_of(values, seed, realizations)
    experiment = Experiment(study.groups["accuracy"], seed)
    early = SOLVERS[int(values[-1])] == "early"
    model = experiment.model
    streams = range(realizations)
    estimates = np.empty((len(FMAX_HZ), len(AMPLITUDES_NM), realizations, len(model.parameters)))
    for a, amplitude in enumerate(AMPLITUDES_NM):
        data = [experiment.measure(amplitude, r) for r in streams]
        for k, fmax in enumerate(FMAX_HZ):
            problems = [experiment.problem(d, fmax) for d in data]
            rngs = [start_stream(seed, r) for r in streams]
            if early:
                starts = np.stack([uniform(model, rng, EARLY_STARTS) for rng in rngs])
                fits = fit_many(problems, starts, "lm", Options(max_iterations=EARLY))
            else:
                fits = fit_many(problems, linearised_many(problems, rngs, 1))
            estimates[k, a] = [f.estimate[f.best] for f in fits]
    return reduced(model, estimates, sway_rms(model, float(values[len(PARAMETERS)])), experiment.f)


def reduced(model: Model, estimates: np.ndarray, sway: np.ndarray, f: np.ndarray) -> Moments:
    """Moments of estimates (3, 2, R, 12) in the model's order; ``f``: frequency points of the influence, Hz."""
    order = [model.names.index(name) for name in PARAMETERS]
    sums = [[model.names.index(n) for n in pair] for pair in COMBINED]
    truth = np.concatenate([model.truth[order], [model.truth[s].sum() for s in sums]])
    x = np.concatenate([estimates[..., order], np.stack([estimates[..., s].sum(axis=-1) for s in sums], axis=-1)], -1)
    ratio = x / truth
    matter = influence(model, model.truth, f).values[order]
    return Moments(ratio.mean(axis=2) - 1.0, ratio.std(axis=2, ddof=1), sway, matter)


def sway_rms(model: Model, noise: float) -> np.ndarray:
    """RMS of noise-evoked sway, deg, (2 spans, 2 angles): zero-mean over the whole record, and over one cycle.

    Exact: the integral of the closed-form density; the mean over a span T removes sinc^2(f T) of each frequency.
    """
    sensor = SensorNoise((noise * PSD[0], noise * PSD[1]))
    n = round(CYCLE_S * CYCLES * RATE_HZ)
    f = record_frequencies(n, RATE_HZ)[1 : n // 10]  # to 20 Hz: above it sway is nil
    power = np.einsum("nii->ni", sway_psd(model, model.truth, sensor, f)).real * f[0]
    cycle = 1.0 - np.sinc(f * CYCLE_S) ** 2
    return np.degrees(np.sqrt(np.stack([power.sum(axis=0), (power * cycle[:, None]).sum(axis=0)])))
