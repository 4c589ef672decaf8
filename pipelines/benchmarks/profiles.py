"""Profile likelihood intervals beside pyPESTO's: the same recording, minimum, threshold and model function.

Ours are `mcstudy.identification.profile.profiles`; pyPESTO follows each profile in steps with fides (exact gradient and
Gauss-Newton Hessian), and interpolates where it crosses the threshold. Parameters whose interval data end on both
sides. Where ends differ SciPy's least squares judges: an end is right if a body with the parameter at that value has
a deviance below the threshold, and none was found with it farther out.
"""

from __future__ import annotations

import logging
import time
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mcstudy.effect_library.simulation import simulate
from mcstudy.fitting.penalised import Fitter, whiten
from mcstudy.fitting.problem import Data, Problem
from mcstudy.identification.bounds import bounded
from mcstudy.identification.estimate import Estimate
from mcstudy.identification.fit import fit, fit_lines
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.minimum import search, without_prior
from mcstudy.identification.profile import profiles
from mcstudy.identification.settings import FitSettings
from mcstudy.models.quantities import parameter
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.streams import stream
from pipelines.benchmarks.model import Compiled
from pipelines.benchmarks.report import Result, Sizes
from pipelines.validation.coverage import Condition, Source

CYCLES, FMAX, HIGHEST = 6, 3.1, 8.0

FAR, STARTS, ERROR = 0.01, 5, 1e-6
"""Distance of two ends, in widths, from which it is judged who is right; starts of least squares beside our end; and
the error of a deviance."""

BEYOND = 0.8
"""Likelihood ratio down to which pyPESTO follows a profile, relative to that at the threshold: it interpolates."""


def fitted(realization: int) -> FitRecord:
    """The fit of a simulated recording."""
    source = Source(Condition(0, CYCLES, FMAX))
    return fit_lines(source(stream(realization, "profiles")), two_segment(), curve=())


def ended(fit: FitRecord) -> list[Estimate]:
    """Parameters whose interval data end on both sides."""
    return [e for e in fit.estimates if e.name in fit.model.names and e.low_from == e.high_from == "data"]


def own(fit: FitRecord, names: list[str]) -> np.ndarray:
    """Ends (K, 2) of the intervals of parameters."""
    wanted = [parameter(fit.model, name) for name in names]
    rise = np.array([fit[name].profile.rise[0] for name in names])
    fitter = Fitter(fit.model, without_prior(fit.model, fit.model), fit.lines.f)
    return np.array([(p.low, p.high) for p in profiles(fitter, Data.of(fit.lines), fit.minima, wanted, rise, ())])


def pypesto(fit: FitRecord, names: list[str]) -> np.ndarray:
    """Ends (K, 2) by pyPESTO's profiles from the same minimum; nan where it raises."""
    import pypesto.optimize
    import pypesto.profile

    logging.getLogger("fides").setLevel(logging.ERROR)
    data = Data.of(fit.lines)
    model = Compiled(Problem(data.f, data.y, data.weight, fit.model))
    task = pypesto.Problem(
        objective=pypesto.Objective(fun=model.value, grad=model.gradient, hess=model.hessian),
        lb=np.zeros(model.width.size),
        ub=np.ones(model.width.size),
        x_names=list(fit.model.names),
        x_guesses=((fit.theta - model.lower) / model.width)[None],
    )
    optimizer = pypesto.optimize.FidesOptimizer(verbose=logging.ERROR, hessian_update=None)
    quiet: dict[str, Any] = {"engine": pypesto.engine.SingleCoreEngine(), "progress_bar": False}
    result = pypesto.optimize.minimize(task, optimizer, n_starts=1, **quiet)
    out = np.full((len(names), 2), np.nan)
    for row, name in zip(out, names, strict=True):
        k, ratio = fit.model.names.index(name), float(np.exp(-fit[name].profile.rise[0] / 2))
        options = pypesto.profile.ProfileOptions(ratio_min=BEYOND * ratio)
        found = pypesto.profile.parameter_profile(
            task, result, optimizer, profile_index=[k], profile_options=options, **quiet
        ).profile_result.list[-1][k]
        ends = pypesto.profile.calculate_approximate_ci(found["x_path"][k], found["ratio_path"], ratio)
        row[:] = model.lower[k] + model.width[k] * np.array(ends)
    return out


def ours_is_right(fit: FitRecord, name: str, side: int, theirs: float) -> bool:
    """Whether our end (``side`` 0 or 1) of a parameter is right and ``theirs`` is not.

    Where theirs is shorter or missing, the body at our end shows it. Where it is longer, least squares with the
    parameter at that value, from the body at our end and `STARTS` around it, must find none below the threshold.
    """
    profile, data, model = fit[name].profile, Data.of(fit.lines), fit.model
    mine, theta = ((profile.low, profile.low_theta), (profile.high, profile.high_theta))[side]
    ceiling = fit.chi2 + profile.rise[-side] + ERROR
    residual = whiten(data.weight, data.y - frf(model, theta, data.f))
    if residual @ residual > ceiling:
        return False
    if not (theirs - mine) * (-1, 1)[side] > 0:
        return True
    free = np.arange(theta.size) != model.names.index(name)
    low, high, scale = model.lower[free], model.upper[free], np.abs(model.truth[free])

    def whole(x: np.ndarray) -> np.ndarray:
        out = np.full(theta.size, theirs)
        out[free] = x * scale
        return out

    def least(start: np.ndarray) -> float:
        found = least_squares(
            lambda x: whiten(data.weight, data.y - frf(model, whole(x), data.f)),
            np.clip(start[free], low + 1e-9 * (high - low), high - 1e-9 * (high - low)) / scale,
            jac=lambda x: -whiten(data.weight, frf_jacobian(model, whole(x), data.f)[1])[:, free] * scale,
            bounds=(low / scale, high / scale),
            xtol=1e-12,
            ftol=1e-12,
        )
        return 2 * float(found.cost)

    rng = np.random.default_rng(0)
    starts = [theta, *(theta * (1 + 0.3 * rng.standard_normal((STARTS, theta.size))))]
    return all(least(start) > ceiling for start in starts)


def one_recording() -> dict[str, float]:
    """CPU seconds of one recording (two trials of six cycles, up to 8 Hz), once compiled code is loaded.

    ``search``: all starts of the fit. ``fit_lines``: the same with corrections and all profiles. ``whole_fit``: all
    that `mcstudy.fit` does.
    """
    recording = simulate(cycles=CYCLES, seed=3)
    nominal, lines = two_segment(), measure(recording, HIGHEST)
    model = bounded(nominal, nominal, {})
    fitter, data = Fitter(model, without_prior(model, nominal), lines.f), Data.of(lines)
    work = {
        "search": lambda: search(fitter, data, 0),
        "fit_lines": lambda: fit_lines(lines, nominal),
        "whole_fit": lambda: fit(recording, FitSettings(fmax=HIGHEST)),
    }
    spent = {}
    for name, call in work.items():
        call()  # loads compiled code
        began = time.process_time()
        call()
        spent[name] = time.process_time() - began
    return spent


def run(sizes: Sizes) -> Result:
    """CPU time per interval, and how far apart the ends are in widths of the interval."""
    result = Result("profiles")
    result.keys |= {f"profiles.{name}_cpu_s": seconds for name, seconds in one_recording().items()}
    spent, apart = {"mcstudy": 0.0, "pypesto": 0.0}, []
    right, differ = list[bool](), list[str]()
    own(first := fitted(0), [e.name for e in ended(first)[:1]])  # compiles
    try:
        pypesto(first, [ended(first)[0].name])
    except ImportError as error:
        result.notes.append(f"pypesto: package not installed, left out ({error})")
        return result
    for r in range(sizes.realizations):
        one = fitted(r)
        names = [e.name for e in ended(one)][: 2 if sizes.repeats == 1 else None]
        ends = {}
        for label, compute in (("mcstudy", own), ("pypesto", pypesto)):
            began = time.process_time()
            ends[label] = compute(one, names)
            spent[label] += time.process_time() - began
        width = np.diff(ends["mcstudy"], axis=1)
        apart.append((ends["pypesto"] - ends["mcstudy"]) * [-1, 1] / width)
        for k, side in np.argwhere(~(np.abs(apart[-1]) < FAR)):
            right.append(ours_is_right(one, names[k], int(side), ends["pypesto"][k, side]))
            differ.append(f"recording {r}, {names[k]}, {('low', 'high')[side]}: {apart[-1][k, side]:.2f}")
    off = np.concatenate(apart)
    result.table = [{"program": k, "CPU ms per interval": 1e3 * v / len(off)} for k, v in spent.items()]
    result.keys["profiles.pypesto"] = spent["pypesto"] / spent["mcstudy"]
    result.keys["profiles.apart_median"] = float(np.median(np.abs(off)))
    result.keys["profiles.apart_most"] = float(np.abs(off).max())
    result.keys["profiles.shorter"] = float((off < -0.01).mean())
    result.keys["profiles.ours_right"] = float(np.mean(right)) if right else float("nan")
    result.notes.append(
        f"{len(right)} ends differ by more than {FAR:g} widths; ours is right at {sum(right)} of them: "
        + "; ".join(f"{text}{'' if ok else ' (ours is not)'}" for text, ok in zip(differ, right, strict=True))
    )
    result.notes.append(
        f"{len(off)} intervals, {sizes.realizations} recordings. apart: pyPESTO's ends from ours, in widths. shorter: "
        "share of ends at which pyPESTO's interval is shorter by more than 1 % of the width"
    )
    return result
