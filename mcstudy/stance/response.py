"""Closed-form frequency responses of a model table, with exact derivatives.

The reference evaluation, in plain numpy and batched over parameter vectors; the compiled fit kernel reads the same
table and is tested against this module.

Conventions: ``theta`` has shape (..., P), frequencies ``f`` in Hz have shape (N,), s = 2 pi i f; results keep the
batch axes first. A model has R rows and angles and Y outputs. FRFs are output per unit of stimulus (rad per N m for an
angle under a torque).
"""

from __future__ import annotations

import numpy as np

from mcstudy.stance.feedback import ORDERS, Model, Table


def _filters(
    table: Table, theta: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, dict[tuple[int, int], tuple[np.ndarray, np.ndarray]]]:
    """Numerators and denominators (2, ..., F, N), and by (filter, parameter) their derivatives, each (..., N)."""
    batch = theta.shape[:-1]
    sides = np.zeros((2, *batch, table.n_filters, s.shape[-1]), dtype=complex)
    zero = np.zeros((*batch, s.shape[-1]), dtype=complex)
    slopes: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}
    for (f, side, order, power2, p1, p2), power1, c in zip(
        table.monomial.tolist(), table.monomial_power.tolist(), table.monomial_coefficient, strict=True
    ):
        a = theta[..., p1, None] if p1 >= 0 else np.ones((*batch, 1))
        b = theta[..., p2, None] if p2 >= 0 else np.ones((*batch, 1))
        base = c * s**order
        sides[side, ..., f, :] += base * a**power1 * b**power2
        for p in {p1, p2} - {-1}:
            if (f, p) not in slopes:
                slopes[f, p] = (zero.copy(), zero.copy())
        if p1 >= 0:
            slopes[f, p1][side][...] += base * power1 * a ** (power1 - 1) * b**power2
        if p2 >= 0:
            slopes[f, p2][side][...] += base * a**power1 * power2 * b ** (power2 - 1)
    return sides, slopes


def _filter_values(table: Table, theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Filter values (..., F, N)."""
    numerator, denominator = _filters(table, theta, s)[0]
    return np.asarray(numerator / denominator)


def _filter_slopes(
    table: Table, theta: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, list[list[tuple[int, np.ndarray]]]]:
    """Filter values (..., F, N), and of each filter the parameters in it with its logarithmic derivatives (..., N)."""
    (numerator, denominator), slopes = _filters(table, theta, s)
    log_slopes: list[list[tuple[int, np.ndarray]]] = [[] for _ in range(table.n_filters)]
    for (f, p), (above, below) in sorted(slopes.items(), key=lambda x: x[0]):
        log_slopes[f].append((p, above / numerator[..., f, :] - below / denominator[..., f, :]))
    return numerator / denominator, log_slopes


def _group_values(model: Model, theta: np.ndarray, s: np.ndarray, filters: np.ndarray) -> np.ndarray:
    """exp(-delay s) * filters(s) per group, (..., G, N); zero at lines where its terms are not there."""
    table = model.table
    out = np.ones((*theta.shape[:-1], len(table.group_delay), s.shape[-1]), dtype=complex)
    for g, delays in enumerate(table.group_delay):
        for delay in delays[delays >= 0]:
            out[..., g, :] *= np.exp(-theta[..., delay, None] * s)
        for k in table.group_filters[g]:
            if k >= 0:
                out[..., g, :] *= filters[..., k, :]
    there = present(model, s.shape[-1])
    return out if there is None else out * there


def present(model: Model, n: int) -> np.ndarray | None:
    """(G, n), 1 where the terms of a group are there, else 0; None where all loops are the same."""
    at, only = model.stimulus_at(n) if model.loops_differ else None, model.table.group_only[:, None]
    return None if at is None else ((only < 0) | (only == at)).astype(float)


def sensed_stimulus(model: Model, n: int) -> np.ndarray | None:
    """(E, n), 1 where a term senses the stimulus that evokes a line of a joint set, else 0; None for one stimulus."""
    at = model.stimulus_at(n)
    return None if at is None else (model.table.stimulus[:, None] == at).astype(float)


def system(model: Model, theta: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A(s) of shape (..., N, R, R) and b(s) of shape (..., N, R) at complex ``s``, (N,) or (..., N).

    A joint model (`mcstudy.stance.joint`) has the b(s) of each line's own stimulus.
    """
    table, theta, s = model.table, np.asarray(theta), np.asarray(s, dtype=complex)
    return _system(model, theta, s, _group_values(model, theta, s, _filter_values(table, theta, s)))


def _system(model: Model, theta: np.ndarray, s: np.ndarray, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    table, R = model.table, model.n_rows
    # Summed in whole rows of memory, one for each (row, angle or stimulus), which takes half the time.
    out = np.zeros((R, R + 1, *theta.shape[:-1], s.shape[-1]), dtype=complex)
    gains, power = table.gains(theta), {order: s**order for order in set(table.entry[:, 1].tolist())}
    sensed = sensed_stimulus(model, s.shape[-1])
    for e, (row, order, group, _, _) in enumerate(table.entry.tolist()):
        value = gains[..., e, None] * power[order] * groups[..., group, :]
        for k, weight in enumerate(table.weight[e, 1:].tolist()):
            if weight:
                heard = value if k < R or sensed is None else value * sensed[e]
                out[row, k] += heard if weight == 1.0 else weight * heard
    A, b = np.moveaxis(out[:, :R], (0, 1), (-2, -1)), np.moveaxis(out[:, R], 0, -1)
    return np.ascontiguousarray(A), 0.0 - b


def frf(model: Model, theta: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Frequency responses of the outputs to the stimulus in closed form.

    Parameters
    ----------
    model
        The table.
    theta
        (..., P), parameter values, e.g. ``model.truth``.
    f
        (N,), frequencies, Hz; of a joint model those of its blocks.

    Returns
    -------
    numpy.ndarray
        (..., N, Y) complex, in the outputs' units per unit of the stimulus; columns are the model's ``output_names``:
        its angles as measured (output filters on), or its declared ``outputs``.
    """
    theta, s = np.asarray(theta), 2j * np.pi * np.asarray(f, dtype=float)
    A, b = system(model, theta, s)
    H = np.linalg.solve(A, b[..., None])[..., 0]
    H = H * _output(model, theta, s)
    if not model.outputs:
        return H
    C, d = output_matrices(model, s)
    return np.asarray(np.einsum("nyr,...nr->...ny", C, H) + d)


def output_matrices(model: Model, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """C(s) (N, Y, R) and d(s) (N, Y) of outputs C q + d u, q the R angles as measured, at complex ``s`` (N,).

    Known numbers, without parameters; the identity and zero where the angles are the outputs. Of a joint model d is
    that of each line's own stimulus.
    """
    weight, R, at = model.table.output_weight, model.n_rows, model.stimulus_at(s.size)
    used = [k for k in range(len(ORDERS)) if weight[..., k].any()]
    powers = np.stack([s ** ORDERS[k] for k in used], axis=-1)
    every = np.einsum("yrk,nk->nyr", weight[..., used], powers)
    d = every[:, :, R] if at is None else every[np.arange(s.size), :, R + at]
    return every[..., :R], d


def replies(model: Model, theta: np.ndarray, s: np.ndarray, A: np.ndarray) -> np.ndarray:
    """(N, Y, R) outputs per unit of torque by row, with ``A`` (N, R, R) of `system` at complex ``s`` (N,)."""
    angles = _output(model, theta, s)[..., None] * np.linalg.inv(A)
    return np.asarray(output_matrices(model, s)[0] @ angles) if model.outputs else angles


def _output(model: Model, theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Output filters per angle, (..., N, R)."""
    table = model.table
    value = np.ones((*theta.shape[:-1], s.size, model.n_rows), dtype=complex)
    if (table.output_filter >= 0).any():
        filters = _filter_values(table, theta, s)
        for angle, k in enumerate(table.output_filter):
            if k >= 0:
                value[..., angle] = filters[..., k, :]
    return value


def frf_jacobian(model: Model, theta: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """FRFs (..., N, Y) and their exact derivatives (..., N, Y, P) in every parameter.

    Derived: dH = -A^-1 (dA H - db), with dA and db read term by term from the table.
    """
    table, theta, s = model.table, np.asarray(theta), 2j * np.pi * np.asarray(f, dtype=float)
    filters, log_slopes = _filter_slopes(table, theta, s)
    groups = _group_values(model, theta, s, filters)
    A, b = _system(model, theta, s, groups)
    inverse = np.linalg.inv(A)
    H = np.einsum("...ij,...j->...i", inverse, b)
    force = _force_slopes(model, theta, s, H, groups, log_slopes)
    dH = -np.einsum("...ij,...jp->...ip", inverse, np.ascontiguousarray(np.moveaxis(force, (0, 1), (-2, -1))))
    if (table.output_filter >= 0).any():
        value = _output(model, theta, s)
        H = H * value
        dH = dH * value[..., None]
        for angle, k in enumerate(table.output_filter):
            for p, log_slope in log_slopes[k] if k >= 0 else ():
                dH[..., angle, p] += H[..., angle] * log_slope
    if not model.outputs:
        return H, dH
    C, d = output_matrices(model, s)
    return np.einsum("nyr,...nr->...ny", C, H) + d, np.einsum("nyr,...nrp->...nyp", C, dH)


def _force_slopes(
    model: Model,
    theta: np.ndarray,
    s: np.ndarray,
    H: np.ndarray,
    groups: np.ndarray,
    log_slopes: list[list[tuple[int, np.ndarray]]],
) -> np.ndarray:
    """dA H - db of every parameter, (row, P, ..., N)."""
    table = model.table
    force = np.zeros((model.n_rows, table.n_parameters, *theta.shape[:-1], s.shape[-1]), dtype=complex)
    drive = sensed_stimulus(model, s.shape[-1])
    angles, power = np.moveaxis(H, -1, 0).copy(), {order: s**order for order in set(table.entry[:, 1].tolist())}
    for e, (row, order, group, g1, g2) in enumerate(table.entry.tolist()):
        delays, filtered = table.group_delay[group], table.group_filters[group]
        if g1 < 0 and g2 < 0 and delays.max() < 0 and filtered.max() < 0:
            continue  # no parameter is in this term
        coefficient, *weights, stimulus = table.weight[e].tolist()
        sensed: np.ndarray | float = 0.0
        for k, weight in enumerate(weights):
            if weight:
                sensed = sensed + weight * angles[k] if k else weight * angles[k]
        if stimulus:
            sensed = sensed + (stimulus if drive is None else stimulus * drive[e])
        unit = coefficient * power[order] * groups[..., group, :] * sensed
        first = theta[..., g1, None] if g1 >= 0 else 1.0
        second = theta[..., g2, None] if g2 >= 0 else 1.0
        if g1 >= 0:
            force[row, g1] += unit * second
        if g2 >= 0:
            force[row, g2] += unit * first
        if delays.max() < 0 and filtered.max() < 0:
            continue
        total = unit * first * second
        for delay in delays[delays >= 0]:
            force[row, delay] += -s * total
        for k in filtered[filtered >= 0]:
            for p, log_slope in log_slopes[k]:
                force[row, p] += total * log_slope
    return force


def force_slopes(model: Model, theta: np.ndarray, s: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(dA/dtheta) q of given ``angles`` q (..., N, R) of a loop without stimulus, (row, P, ..., N)."""
    filters, log_slopes = _filter_slopes(model.table, theta, s)
    return _force_slopes(model, theta, s, angles, _group_values(model, theta, s, filters), log_slopes)


def noise_response(model: Model, theta: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Response of the outputs to noise on each of the S = R sensed angles, (..., N, Y, S).

    Noise adds to what the ``noisy`` terms sense, so q = -A^-1 N(s) n with N the noisy part of A.
    """
    theta, s = np.asarray(theta), 2j * np.pi * np.asarray(f, dtype=float)
    A, _ = system(model, theta, s)
    N = active(model, theta, s)
    response = -np.linalg.solve(A, N) * _output(model, theta, s)[..., None]
    return np.einsum("nyr,...nrs->...nys", output_matrices(model, s)[0], response) if model.outputs else response


def active(model: Model, theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """The noisy (active, delayed) part of A(s), shape (..., N, R, R)."""
    table, theta, s = model.table, np.asarray(theta), np.asarray(s, dtype=complex)
    groups = _group_values(model, theta, s, _filter_values(table, theta, s))
    N, gains = np.zeros((*theta.shape[:-1], s.size, model.n_rows, model.n_rows), dtype=complex), table.gains(theta)
    for e, (row, order, group, _, _) in enumerate(table.entry):
        if table.noisy[e]:
            value = gains[..., e, None] * s**order * groups[..., group, :]
            for column in range(model.n_rows):
                N[..., row, column] += table.weight[e, 1 + column] * value
    return N


def neural_controllers(model: Model, theta: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Active plus passive feedback FRFs, shape (..., N, row, angle): torque on each row per sensed angle.

    For the two-segment model these are the paper's four controllers T12, T22 (hip row) and T11, T21 (ankle row),
    every term that carries a gain and is neither inertia, gravity nor stimulus (Goodworth & Peterka 2018, Methods).
    """
    table, theta, s = model.table, np.asarray(theta), 2j * np.pi * np.asarray(f, dtype=float)
    groups = _group_values(model, theta, s, _filter_values(table, theta, s))
    NC, gains = np.zeros((*theta.shape[:-1], s.size, model.n_rows, model.n_rows), dtype=complex), table.gains(theta)
    for e, (row, order, group, g1, _) in enumerate(table.entry):
        if g1 >= 0 and table.weight[e, -1] == 0:
            value = gains[..., e, None] * s**order * groups[..., group, :]
            for column in range(model.n_rows):
                NC[..., row, column] += table.weight[e, 1 + column] * value
    return NC
