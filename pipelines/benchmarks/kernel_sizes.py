"""Time and operations of one iteration for one to four rows, and the fraction of this core's peak.

Joints that all feed back to one another, with 2 R^2 + 2 R parameters: gains and a delay in each row. One joint also
without its spring, so that its parameters fill a tile of the Gram matrix, and without its delay: what these cost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mcstudy.fitting.kernel import TILE
from mcstudy.fitting.plans import plan
from mcstudy.fitting.problem import Problem, paper_cost
from mcstudy.fitting.solvers import Options, fit
from mcstudy.fitting.starts import uniform
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf
from pipelines.benchmarks import counting
from pipelines.benchmarks.kernel_time import peak_flops
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes

F = np.arange(1, 29) / 4.0
"""Hz."""

ITERATIONS = 12
"""Of each fit: all of them go on, so that the lanes stay full."""


SIZES = (1, 2, 3, 4)
"""Numbers of joints."""

LESS = {"1x1, no spring": "K0", "1x1, no delay": "T0"}
"""One joint without a parameter."""


def joints(R: int) -> Model:
    """A loop of R joints, whose numbers mean nothing."""
    rng = np.random.default_rng(R)
    names = tuple(f"joint {k + 1}" for k in range(R))
    root = rng.normal(size=(R, R))
    inertia = root @ root.T + np.eye(R)
    parameters, terms = [], [Term(names[0], "stimulus")]
    for k, row in enumerate(names):
        parameters += [Parameter(f"K{k}", "", 1.0, 0.0, 2.0), Parameter(f"T{k}", "s", 0.1, 0.05, 0.15)]
        terms.append(Term(row, row, f"K{k}"))
        for j, sensed in enumerate(names):
            terms.append(Term(row, sensed, order=2, coefficient=inertia[k, j]))
            for kind, order in (("P", 0), ("D", 1)):
                name = f"{kind}{k}{j}"
                value = rng.normal() + 3.0 * (j == k)
                parameters.append(Parameter(name, "", value, value - 4.0, value + 4.0))
                terms.append(Term(row, sensed, name, order, f"T{k}"))
    return Model(f"{R} joints", tuple(parameters), tuple(terms), angles=names)


def without(model: Model, name: str) -> Model:
    """The model without a gain and its term, or without a delay."""
    terms = tuple(replace(t, delay=None) if t.delay == name else t for t in model.terms if name not in t.gain)
    return replace(model, parameters=tuple(p for p in model.parameters if p.name != name), terms=terms)


def problem(R: int, less: str = "") -> Problem:
    """Responses of R joints with errors of 10 %; ``less``: a parameter that is left out."""
    model, rng = without(joints(R), less), np.random.default_rng(1)
    y = frf(model, model.truth, F)
    return paper_cost(model, F, y * (1 + 0.1 * (rng.normal(size=y.shape) + 1j * rng.normal(size=y.shape))))


def _padding(p: Problem) -> int:
    """Operations of an evaluation that fill up the tiles of the Gram matrix: a complex product's real part is four."""
    table = plan(p.model, p.f)
    wide, P = table.single.size, int((table.single >= 0).sum())
    return 4 * p.f.size * (wide * (wide + TILE) // 2 - P * (P + 1) // 2)


def run(sizes: Sizes) -> Result:
    """For each R: microseconds and operations per iteration, and the fraction of the peak; timed alternately."""
    result = Result("kernel_sizes")
    problems = {f"{R}x{R}": problem(R) for R in SIZES} | {name: problem(1, less) for name, less in LESS.items()}
    n_starts, options = 16 if sizes.starts < 50 else 128, Options(0.0, ITERATIONS)
    pools = {name: uniform(p.model, np.random.default_rng(1), n_starts) for name, p in problems.items()}
    seconds: dict[str, list[float]] = {name: [] for name in problems}
    iterations, peaks = dict.fromkeys(problems, 0), []
    for _ in range(5 * sizes.repeats):
        peaks.append(peak_flops(3))
        for name, p in problems.items():
            fits, took = timed(fit, p, pools[name], "lm", options)
            iterations[name] = int(fits.iterations.sum())
            seconds[name].append(took)
    peak = float(np.median(peaks))
    result.keys["kernel_sizes.peak_gflops"] = peak / 1e9
    for name, p in problems.items():
        us = float(np.median(seconds[name][1:] or seconds[name])) / iterations[name] * 1e6
        evaluate, _ = counting.evaluation(p, p.model.truth)
        whole, passes = counting.whole(p, pools[name][:8], 0.0, 3)
        step = whole / passes - evaluate
        evaluate -= _padding(p)
        flops = evaluate + step
        fraction = flops / (us * 1e-6) / peak
        result.table.append(
            {
                "joints": name,
                "parameters": p.model.truth.size,
                "us an iteration": us,
                "flops an evaluation": evaluate,
                "flops a step": step,
                "GFLOP/s": flops / us / 1e3,
                "of the peak": fraction,
            }
        )
        key = name.replace(", ", "_").replace(" ", "_")
        result.keys[f"kernel_sizes.iteration_us.{key}"] = us
        result.keys[f"kernel_sizes.step_flops.{key}"] = step
        result.keys[f"kernel_sizes.flops_per_iteration.{key}"] = flops
        result.keys[f"kernel_sizes.fraction_of_peak.{key}"] = fraction
    result.notes.append("operations counted by running the kernel's source with counting lanes (benchmarks.counting),")
    result.notes.append("without those on places of tiles of the Gram matrix that no parameter takes")
    return result
