"""Identify the four neural controllers from two stimuli without a model of them, and from one stimulus.

This is the alternative of Boonstra et al. 2013 and Engelhart et al. 2015 that Goodworth & Peterka 2018 discuss. For
each controller, up to 1.2 Hz and relative to its true magnitude, the script prints three numbers averaged over
frequency: the error of the mean estimate, the error expected from chance alone (for an unbiased estimator), and the
error of a single experiment. All estimators use two trials of six cycles, except the parametric fit, which uses one.
``-o FILE`` saves the result for ``mcstudy report OUT --beside FILE``.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mcstudy_goodworth2018.alternatives import nonparametric
from mcstudy_goodworth2018.alternatives.files import write_alternative
from mcstudy_goodworth2018.alternatives.two_stimuli import TwoStimuli

from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.problem import paper_cost
from mcstudy.fitting.solvers import fit
from mcstudy.spectra.bands import odd_lines, published
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import neural_controllers
from mcstudy.stance.stimulus import Prts

FMAX = 1.2
HIP_AMPLITUDE = 2.0

points = odd_lines(FMAX)
ankle = Prts(amplitude=5.0)
both, single = TwoStimuli(ankle, HIP_AMPLITUDE, points), TwoStimuli(ankle, 0.0, points)
model = both.model
fitted_points = published().below(FMAX)
parametric_experiment = SpectralExperiment(model, model.truth, ankle, SensorNoise(), fitted_points)


def two_stimuli(rng: np.random.Generator) -> np.ndarray:
    """Cross-spectra with both stimuli."""
    s = both.realization(rng)
    return nonparametric.indirect(s.sway, s.torque, s.stimuli, points)


def torque_over_angle(rng: np.random.Generator) -> np.ndarray:
    """Each torque over each angle, one stimulus."""
    s = single.realization(rng)
    return nonparametric.one_angle(s.sway, s.torque, s.stimuli[..., 0], points)


def direct(rng: np.random.Generator) -> np.ndarray:
    """Torques regressed on both angles, one stimulus; noise makes it solvable."""
    s = single.realization(rng)
    return nonparametric.direct(s.sway, s.torque, points)


def parametric(rng: np.random.Generator) -> np.ndarray:
    """The paper's way: 12 parameters fitted to FRFs of one stimulus."""
    data, _ = parametric_experiment.frf(parametric_experiment.realization(rng), ankle.amplitude)
    problem = paper_cost(model, fitted_points.f, data)
    fits = fit(problem, linearised(problem, rng, 1))
    return neural_controllers(model, fits.estimate[fits.best], points.f)


ESTIMATORS: dict[str, tuple[Callable[[np.random.Generator], np.ndarray], int]] = {
    "two stimuli, cross-spectra": (two_stimuli, 2),
    "one stimulus, torque / angle": (torque_over_angle, 1),
    "one stimulus, direct": (direct, 1),
    "one stimulus, 12 parameters": (parametric, 1),
}
CONTROLLERS = {"T11": (1, 0), "T21": (1, 1), "T12": (0, 0), "T22": (0, 1)}


def errors(estimator: Callable[[np.random.Generator], np.ndarray], n: int, seed: int) -> dict[str, dict[str, Any]]:
    """For each controller, in percent by frequency: error of the mean, expected from chance, of one experiment."""
    truth = neural_controllers(model, model.truth, points.f)
    error = 100 * (np.stack([estimator(rng) for rng in np.random.default_rng(seed).spawn(n)]) / truth - 1)
    off = np.abs(error.mean(axis=0))
    chance = np.sqrt(np.pi / 4 * error.var(axis=0, ddof=1) / n)
    single_error = np.sqrt(np.mean(np.abs(error) ** 2, axis=0))
    return {
        label: {"off": off[:, r, c], "chance": chance[:, r, c], "single": single_error[:, r, c]}
        for label, (r, c) in CONTROLLERS.items()
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--realizations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2013)
    parser.add_argument("-o", "--output", type=Path)
    a = parser.parse_args()
    header = ("percent of the true magnitude", "controller", "mean error", "by chance", "one experiment")
    print("{:<30}{:>12}{:>13}{:>11}{:>16}".format(*header))
    found = []
    for name, (estimator, stimuli) in ESTIMATORS.items():
        controllers = errors(estimator, a.realizations, a.seed)
        for label, e in controllers.items():
            numbers = (e[key].mean() for key in ("off", "chance", "single"))
            print("{:<30}{:>12}{:>13.1f}{:>11.1f}{:>16.1f}".format(name, label, *numbers))
        lists = {label: {k: v.tolist() for k, v in e.items()} for label, e in controllers.items()}
        found.append({"name": name, "stimuli": stimuli, "controllers": lists})
    if a.output:
        command = f"python {Path(__file__).name} --realizations {a.realizations} --seed {a.seed} -o {a.output.name}"
        settings = {
            "realizations": a.realizations,
            "ankle torque, N m": ankle.amplitude,
            "hip torque, N m": HIP_AMPLITUDE,
            "highest frequency, Hz": FMAX,
        }
        result = {"kind": "two_stimuli", "command": command, "settings": settings}
        write_alternative(a.output, {**result, "frequency": points.f.tolist(), "estimators": found})
