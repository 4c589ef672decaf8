"""Efficiency of the estimates relative to the best possible unbiased estimator.

The bounds are those of `mcstudy.stance.information`. Weighted least squares with other weights (the paper's cost) has
the *linearised* covariance A^-1 B A^-1 with A = Re(J^H W^H W J), B = Re(J^H W^H W C W^H W J) / 2 (the sandwich). It and
the Cramér-Rao bound hold to first order in the noise and with no active bound. Where fits end on bounds, the estimates
of *all* parameters may scatter less than that, because a bound on one parameter also restricts the parameters that are
correlated with it; the van Trees bound holds for them.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.accuracy import at_bound
from mcstudy.analysis.labels import ONE, labelled, units_of
from mcstudy.analysis.montecarlo import REALIZATION, jackknife
from mcstudy.analysis.selection import inside_bounds
from mcstudy.errors import InputError
from mcstudy.fitting.problem import paper_cost
from mcstudy.fitting.standard_errors import joint_covariance, sandwich
from mcstudy.models.quantities import quantities
from mcstudy.stance.feedback import Model
from mcstudy.stance.information import among_all, cramer_rao, fixed_by_bounds, van_trees
from mcstudy.stance.response import frf, frf_jacobian

INSIDE = 0.9
"""Fraction of best fits that must be off every bound for the Cramér-Rao bound to apply."""


def measured_covariance(cells: xr.Dataset) -> xr.DataArray:
    """Stored noise covariances averaged over realizations, dims (amplitude, frequency, angle, angle_2).

    Raises `InputError` for a group without noise.
    """
    if "noise_covariance" not in cells:
        raise InputError("noise_covariance: the group has none (it was simulated without noise)")
    return cells["noise_covariance"].mean(REALIZATION)


def linearised_covariance(
    model: Model, theta: np.ndarray, f: np.ndarray, weight: np.ndarray, joint: np.ndarray
) -> np.ndarray:
    """First-order covariance (P, P) of least squares with weights ``weight`` (N, 2, 2) for FRF errors ``joint``.

    NaN for parameters that their bounds hold; see `mcstudy.stance.information.cramer_rao`.
    """
    free = np.flatnonzero(~fixed_by_bounds(model, theta, f, joint))
    _, J = frf_jacobian(model, theta, f)
    if not free.size:
        return among_all(np.empty((0, 0)), free, theta.size)
    J, scale = J[..., free], (model.upper - model.lower)[free]
    return among_all(sandwich(J * scale, weight, joint) * scale[:, None] * scale[None, :], free, theta.size)


def bounds_on_sd(
    cells: xr.Dataset, model: Model, covariance: xr.DataArray, overlap: np.ndarray | None = None
) -> xr.Dataset:
    """Smallest possible standard deviations, dims (amplitude, fmax, parameter).

    Parameters
    ----------
    cells: needs ``n_frequencies`` and the coords amplitude, fmax, frequency, parameter: those of the model, or what
        `mcstudy.analysis.derived` makes of them; the variance of a quantity is, to first order, that of the bound.
    model: the bounds are at its truth.
    covariance: of the FRF errors, dims (amplitude, frequency, angle, angle_2), e.g. `measured_covariance`.
    overlap: see `mcstudy.fitting.standard_errors.joint_covariance`.

    Returns
    -------
    Dataset ``cramer_rao`` and ``paper_cost`` (linearised, what the paper's weights cost), in the parameters' units; NaN
    where ``held`` says that the bounds hold the parameter, whatever the data are, and NaN in all of an amplitude and
    Fmax where ``why_not`` (amplitude, fmax) says, in words, why there is none; it is empty elsewhere. ``box`` is the
    root of `van_trees`, NaN only where the covariance of the noise is singular.

    Raises `InputError` for parameters of another model.
    """
    f, truth = cells["frequency"].values, model.truth
    slopes = _slopes(cells, model)
    shape = (cells.sizes["amplitude"], cells.sizes["fmax"], len(slopes))
    bound, paper, box = (np.full(shape, np.nan) for _ in range(3))
    fixed = np.zeros(shape, dtype=bool)
    why_not = np.full(shape[:2], "", dtype=object)
    weight = paper_cost(model, f, frf(model, truth, f)).weight
    for a, C in enumerate(covariance.transpose("amplitude", "frequency", "angle", "angle_2").values):
        for b, n in enumerate(cells["n_frequencies"].values):
            try:
                joint = joint_covariance(C[:n], None if overlap is None else overlap[:n, :n])
                alone = fixed_by_bounds(model, truth, f[:n], joint)
                fixed[a, b] = [alone[np.flatnonzero(k)].any() for k in slopes]
                box[a, b] = _sd_of(van_trees(model, truth, f[:n], joint), slopes)
                bound[a, b] = _sd_of(cramer_rao(model, truth, f[:n], joint), slopes)
                paper[a, b] = _sd_of(linearised_covariance(model, truth, f[:n], weight[:n], joint), slopes)
            except InputError as error:
                why_not[a, b] = str(error)
            except np.linalg.LinAlgError:
                why_not[a, b] = "singular to rounding: the points do not determine the parameters"
            if why_not[a, b]:
                bound[a, b] = paper[a, b] = np.nan
    dims = ("amplitude", "fmax", "parameter")
    coords = {d: cells[d] for d in dims}
    values = {
        "cramer_rao": (dims, bound),
        "paper_cost": (dims, paper),
        "box": (dims, box),
        "held": (dims, fixed),
        "why_not": (dims[:2], why_not.astype(str)),
    }
    units = units_of(cells)
    return labelled(
        xr.Dataset(values, coords=coords),
        cells,
        cramer_rao=("standard deviation at the Cramér-Rao bound", units),
        paper_cost=("standard deviation with the paper's weights, to first order in the noise", units),
        box=("root mean squared error at the van Trees bound within the box of allowed values", units),
        held=_HELD,
        why_not=_WHY_NOT,
    )


_HELD = ("whether its bounds hold the parameter or a part of the sum", ONE)
_WHY_NOT = ("why there is no bound, empty where there is one", ONE)


def _slopes(cells: xr.Dataset, model: Model) -> list[np.ndarray]:
    """Derivatives (P,) of each parameter of the cells, which may be a quantity derived from those of the model."""
    known = {q.label: q.gradient for q in quantities(model)}
    names = [str(n) for n in cells["parameter"].values]
    for name in names:
        if name not in known:
            raise InputError(f"parameter: expected those of model {model.name} or their sums, found {name}")
    return [known[name](model.truth) for name in names]


def _sd_of(covariance: np.ndarray, slopes: list[np.ndarray]) -> np.ndarray:
    """Standard deviations to first order; raises `LinAlgError` where rounding has made a variance negative."""
    variance = []
    for slope in slopes:
        m = np.flatnonzero(slope)
        variance.append((covariance[np.ix_(m, m)] * np.outer(slope[m], slope[m])).sum())
    if (np.array(variance) < 0).any():
        raise np.linalg.LinAlgError("negative variance")
    return np.sqrt(variance)


def bound_applies(cells: xr.Dataset) -> xr.DataArray:
    """Where at least `INSIDE` of the best fits are on *no* bound, dims (amplitude, fmax).

    Elsewhere the Cramér-Rao bound applies to no parameter, not even to one that is inside its own bounds.
    """
    known = cells["cost"].notnull() if "cost" in cells else cells["estimate"].notnull().all("parameter")
    free = inside_bounds(cells) & known
    n = known.sum(REALIZATION)
    return (n > 0) & (free.sum(REALIZATION) >= INSIDE * n)


def efficiency(cells: xr.Dataset, bounds: xr.Dataset) -> xr.Dataset:
    """Cramér-Rao variance divided by the observed variance, per (amplitude, fmax, parameter); 1 is the optimum.

    Parameters
    ----------
    cells: best fits, or these combined. bounds: from `bounds_on_sd`.

    Returns
    -------
    Dataset ``value`` and ``mcse`` (of the observed variance; the error of the bound is far smaller). Both are NaN where
    ``applies`` (amplitude, fmax) is false: there, more than one fit in ten is on *some* bound, and the Cramér-Rao
    bound, which assumes no bounds, cannot be compared with any spread (`bound_applies`). ``box`` and ``box_mcse``
    exist there too: the van Trees bound, which knows the box of allowed values, over the observed mean squared error.
    Also ``n``, ``left_out``, ``cramer_rao_sd``, ``paper_cost_sd``, ``box_rmse``, ``held``, ``why_not`` (see
    `bounds_on_sd`), and for cells that are not combined ``at_bound``, the fraction of fits with the parameter itself on
    a bound.
    """
    x, truth = cells["estimate"], cells["truth"]
    least = jackknife(x, truth, lambda m: bounds["cramer_rao"] ** 2 / m.sd.where(m.sd > 0) ** 2)
    box = jackknife(x, truth, lambda m: bounds["box"] ** 2 / m.mse.where(m.mse > 0))
    applies, name = bound_applies(cells), "efficiency (Cramér-Rao variance over observed variance)"
    result = least.assign(
        value=least["value"].where(applies),
        mcse=least["mcse"].where(applies),
        applies=applies,
        box=box["value"],
        box_mcse=box["mcse"],
        cramer_rao_sd=bounds["cramer_rao"],
        paper_cost_sd=bounds["paper_cost"],
        box_rmse=bounds["box"],
        held=bounds["held"],
        why_not=bounds["why_not"],
    )
    if "at_bound" in cells:
        result["at_bound"] = at_bound(cells)["value"].sum("side", skipna=False)
    within = "van Trees bound within the box of allowed values over observed mean squared error"
    sd = {k: (bounds[k].attrs["long_name"], bounds[k].attrs["units"]) for k in ("cramer_rao", "paper_cost", "box")}
    return labelled(
        result,
        cells,
        name,
        applies=("whether the Cramér-Rao bound applies", ONE),
        box=(within, ONE),
        box_mcse=(f"Monte Carlo standard error of the {within}", ONE),
        cramer_rao_sd=sd["cramer_rao"],
        paper_cost_sd=sd["paper_cost"],
        box_rmse=sd["box"],
        held=_HELD,
        why_not=_WHY_NOT,
        at_bound=("fraction of best fits with the parameter on a bound", ONE),
    )
