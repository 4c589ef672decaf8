"""Time and operations of one iteration, and the fraction of this core's peak.

The peak is measured, not quoted: independent fused multiply-adds on the kernel's own lanes. An iteration is one
evaluation of the model with its derivatives and one step.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mcstudy.fitting.lanes import WIDTH, fma, load, splat, store
from mcstudy.fitting.solvers import fit
from mcstudy.fitting.starts import uniform
from pipelines.benchmarks import counting
from pipelines.benchmarks.cases import cases
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes

MANY, FEW = 16, 6
"""Chains of multiply-adds: as many as hide their latency in 32 registers of AVX-512, and as fit in 16 of AVX2."""


@njit(nogil=True)
def _few(w, n):
    x, y = load(w, 0), splat(1e-9)
    a, b, c, d, e, f = load(w, 1), load(w, 2), load(w, 3), load(w, 4), load(w, 5), load(w, 6)
    for _ in range(n):
        a, b, c = fma(a, x, y), fma(b, x, y), fma(c, x, y)
        d, e, f = fma(d, x, y), fma(e, x, y), fma(f, x, y)
    store(w, 1, a + b + c + d + e + f)


@njit(nogil=True)
def _many(w, n):
    x = load(w, 0)
    y = splat(1e-9)
    a, b, c, d = load(w, 1), load(w, 2), load(w, 3), load(w, 4)
    e, f, g, h = load(w, 5), load(w, 6), load(w, 7), load(w, 8)
    i, j, k, m = load(w, 9), load(w, 10), load(w, 11), load(w, 12)
    o, p, q, r = load(w, 13), load(w, 14), load(w, 15), load(w, 16)
    for _ in range(n):
        a, b, c, d = fma(a, x, y), fma(b, x, y), fma(c, x, y), fma(d, x, y)
        e, f, g, h = fma(e, x, y), fma(f, x, y), fma(g, x, y), fma(h, x, y)
        i, j, k, m = fma(i, x, y), fma(j, x, y), fma(k, x, y), fma(m, x, y)
        o, p, q, r = fma(o, x, y), fma(p, x, y), fma(q, x, y), fma(r, x, y)
    total = a + b + c + d + e + f + g + h
    store(w, 1, total + i + j + k + m + o + p + q + r)


def peak_flops(rounds: int) -> float:
    """Peak of double-precision operations per second of this core, best of ``rounds``."""
    w, n, peaks = np.full((MANY + 1) * WIDTH, 0.999), 200_000, []
    for chains, loop in ((FEW, _few), (MANY, _many)):
        loop(w, 1)
        peaks.append(2.0 * chains * WIDTH * n / min(timed(loop, w, n)[1] for _ in range(rounds)))
    return max(peaks)


def run(sizes: Sizes) -> Result:
    """For each Fmax: microseconds and operations per iteration, and the fraction of the peak; timed alternately."""
    result = Result("kernel")
    repeats, n_starts = 5 * sizes.repeats, 64 if sizes.starts < 50 else 256
    problems = [case for case in cases(1, 8) if case.realization == 0]
    pools = [uniform(c.problem.model, np.random.default_rng(1), n_starts) for c in problems]
    seconds: list[list[float]] = [[] for _ in problems]
    peaks, iterations = [], [0] * len(problems)
    for _ in range(repeats):
        peaks.append(peak_flops(3))
        for k, (case, starts) in enumerate(zip(problems, pools, strict=True)):
            fits, took = timed(fit, case.problem, starts)
            iterations[k] = int(fits.iterations.sum())
            seconds[k].append(took)
    peak = float(np.median(peaks))
    result.keys["kernel.peak_gflops"] = peak / 1e9
    for k, (case, starts) in enumerate(zip(problems, pools, strict=True)):
        took = float(np.median(seconds[k][1:] or seconds[k]))
        evaluate, _ = counting.evaluation(case.problem, case.problem.model.truth)
        flops, passes = counting.whole(case.problem, starts[:8], 1e-12, 12)
        step = flops / passes - evaluate
        us = took / iterations[k] * 1e6
        fraction = (evaluate + step) / (us * 1e-6) / peak
        result.table.append(
            {
                "fmax": case.fmax,
                "points": case.problem.f.size,
                "us an iteration": us,
                "iterations a fit": iterations[k] / n_starts,
                "us a fit": took / n_starts * 1e6,
                "flops an evaluation": evaluate,
                "flops a step": step,
                "GFLOP/s": (evaluate + step) / us / 1e3,
                "of the peak": fraction,
            }
        )
        name = f"fmax_{case.fmax:g}"
        result.keys[f"kernel.iteration_us.{name}"] = us
        result.keys[f"kernel.flops_per_iteration.{name}"] = evaluate + step
        result.keys[f"kernel.fraction_of_peak.{name}"] = fraction
    result.notes.append("operations counted by running the kernel's source with counting lanes (benchmarks.counting)")
    return result
