"""Compare a fit to the mean FRF of a population with the mean of individual fits.

Goodworth & Peterka (2009, 2012) found both to be similar in a homogeneous population. Here the gains, damping and
delays of every subject are scattered uniformly within +-15 % of the truth (unstable subjects are drawn again), each
subject has independent sensor noise, and both methods estimate the mean parameters of the population. The script prints
bias and spread of both over many populations, in percent of the truth, at Fmax 1.2 Hz and 5 N m. ``-o FILE`` saves the
result for ``mcstudy report OUT --beside FILE``.
"""

import argparse
from pathlib import Path

import numpy as np
from mcstudy_goodworth2018.alternatives.files import write_alternative

from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.problem import paper_cost
from mcstudy.fitting.solvers import fit
from mcstudy.spectra.bands import published
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.stability import growth_rate
from mcstudy.stance.stimulus import Prts

COMBINED = {"K11+Kpas1": ("K11", "Kpas1"), "K22+Kpas2": ("K22", "Kpas2")}
SCATTER = 0.15
AMPLITUDE = 5.0
FMAX = 1.2


def subject(model: Model, rng: np.random.Generator) -> np.ndarray:
    """Parameters of one stable subject, (P,)."""
    while True:
        theta = model.truth * (1 + rng.uniform(-SCATTER, SCATTER, model.truth.size))
        if growth_rate(model, theta) < 0:
            return theta


def estimate(model: Model, f: np.ndarray, data: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Best fit of the paper's cost, (P,)."""
    problem = paper_cost(model, f, data)
    fits = fit(problem, linearised(problem, rng, 1))
    return fits.estimate[fits.best]


def population(model: Model, subjects: int, noise: SensorNoise, rng: np.random.Generator) -> np.ndarray:
    """Errors of the two routes, (2, P) in units: mean of fits, fit to the mean FRF."""
    bands = published().below(FMAX)
    thetas = [subject(model, rng) for _ in range(subjects)]
    data = []
    for theta in thetas:
        experiment = SpectralExperiment(model, theta, Prts(), noise, bands)
        data.append(experiment.frf(experiment.realization(rng), AMPLITUDE)[0])
    mean_of_fits = np.mean([estimate(model, bands.f, d, rng) for d in data], axis=0)
    fit_to_mean = estimate(model, bands.f, np.mean(data, axis=0), rng)
    return np.stack([mean_of_fits, fit_to_mean]) - np.mean(thetas, axis=0)


def percent(error: np.ndarray, model: Model) -> dict[str, np.ndarray]:
    """Errors (..., P) of every parameter, and of the sums of active and passive stiffness, in percent of the truth."""
    names, truth = model.names, model.truth
    rows = {name: (name,) for name in names} | COMBINED
    columns = {label: [names.index(n) for n in of] for label, of in rows.items()}
    return {label: 100 * error[..., k].sum(axis=-1) / truth[k].sum() for label, k in columns.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--populations", type=int, default=40)
    parser.add_argument("--subjects", type=int, default=10)
    parser.add_argument("--seed", type=int, default=2009)
    parser.add_argument(
        "--no-noise", action="store_true", help="simulate without sensor noise; only the parameters vary"
    )
    parser.add_argument("-o", "--output", type=Path)
    a = parser.parse_args()
    model = two_segment()
    noise = SensorNoise((0.0, 0.0)) if a.no_noise else SensorNoise()
    streams = np.random.default_rng(a.seed).spawn(a.populations)
    error = np.stack([population(model, a.subjects, noise, rng) for rng in streams])
    routes = percent(error, model)
    print(f"{a.populations} populations of {a.subjects} subjects; percent of the truth, +- Monte Carlo standard error")
    print(f"{'':<10}{'mean of fits: bias':>20}{'SD':>7}{'fit to mean: bias':>20}{'SD':>7}{'difference':>16}")
    rows = []
    for name, values in routes.items():
        root = np.sqrt(a.populations)
        (each, mean), (sd_each, sd_mean) = values.mean(axis=0), values.std(axis=0, ddof=1)
        paired = values[:, 1] - values[:, 0]
        off, error_of = float(paired.mean()), float(paired.std(ddof=1) / root)
        columns = (f"{each:.1f} +- {sd_each / root:.1f}", f"{sd_each:.1f}", f"{mean:.1f} +- {sd_mean / root:.1f}")
        difference = f"{off:.1f} +- {error_of:.1f}"
        print(f"{name:<10}{columns[0]:>20}{columns[1]:>7}{columns[2]:>20}{sd_mean:>7.1f}{difference:>16}")
        both = ("mean_of_fits", each, sd_each), ("fit_to_mean", mean, sd_mean)
        found = {k: {"bias": float(b), "mcse": float(s / root), "sd": float(s)} for k, b, s in both}
        rows.append({"name": name, **found, "difference": {"value": off, "mcse": error_of}})
    if a.output:
        words = f"--populations {a.populations} --subjects {a.subjects} --seed {a.seed}"
        command = f"python {Path(__file__).name} {words}{' --no-noise' * a.no_noise} -o {a.output.name}"
        settings = {
            "populations": a.populations,
            "subjects in each": a.subjects,
            "scatter of parameters, +-%": 100 * SCATTER,
            "sensor noise": "none" if a.no_noise else "the paper's",
            "ankle torque, N m": AMPLITUDE,
            "highest frequency, Hz": FMAX,
        }
        write_alternative(a.output, {"kind": "population", "command": command, "settings": settings, "rows": rows})
