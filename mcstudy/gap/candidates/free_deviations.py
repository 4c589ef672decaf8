"""Models of a cause outside the library: families of deviations instead of a named effect.

- *Free torque*: a smooth complex torque at the ankle, at the hip, or at both. It is a Gaussian process over log
  frequency, in units of the active torque of the loop (plus a tenth of the stimulus), with several sizes and length
  scales.
- *Free sensor*: the same as a relative error of a measured angle.
- *Plain feedback*: one additional feedback path of the simplest form (any row, angle, order and delay; some resonant)
  that the library does not have. Its evidence pays for one gain only, while a free torque pays for its flexibility.

All are linear in the residual of the base fit, so their marginal likelihood has a closed form. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from mcstudy.fitting.penalised import Fitted, whiten
from mcstudy.fitting.problem import Data
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import active, output_matrices, system

LENGTHS = (0.6, 1.2)
"""Length scales of a free torque, in units of ln frequency."""

SIZES = (0.02, 0.1, 0.4)
"""Standard deviations of a free torque, relative to the active torque of the loop."""

RANK = 14
"""Number of smooth functions kept per length scale; the others have less than 1 % of the variance."""

DELAYS_S = (0.0, 0.05, 0.12, 0.25)
MIDDLE_HZ = 0.43
"""Geometric mean of the lowest and the highest line of a standing body, up to 8 Hz."""


def slower(model: Model, f: np.ndarray) -> float:
    """Factor on times of a standing body, 1 for it; those of a declared model have the same place among its lines."""
    return 1.0 if standing(model) else MIDDLE_HZ / float(np.sqrt(f.min() * f.max()))


RESONANCES_HZ = (0.5, 1.0, 2.0, 3.0, 4.5, 6.5)


@dataclass(frozen=True)
class Family:
    """A zero-mean Gaussian deviation.

    Attributes
    ----------
    name: as displayed. locations: where it acts. columns: (4 N, K) whitened, scaled so that the variance of every
        coefficient is one of ``variances``; the marginal likelihood is averaged over them.
    """

    name: str
    locations: tuple[str, ...]
    columns: np.ndarray
    variances: tuple[float, ...]


@lru_cache(maxsize=32)
def _modes(first: float, last: float, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grid of ln frequency (60,), largest eigenvalues (`RANK`,) and eigenvectors (60, `RANK`) of the kernel on it."""
    grid = np.linspace(first, last, 60)
    value, vector = np.linalg.eigh(np.exp(-0.5 * ((grid[:, None] - grid) / length) ** 2))
    keep = np.argsort(value)[::-1][:RANK]
    return grid, value[keep], vector[:, keep]


def smooth_functions(f: np.ndarray, length: float) -> np.ndarray:
    """(N, `RANK`) orthogonal functions whose sum of squares is a unit-variance process smooth over ln f."""
    x = np.log(f)
    grid, value, vector = _modes(round(float(x.min()), 9), round(float(x.max()), 9), length)
    cross = np.exp(-0.5 * ((x[:, None] - grid) / length) ** 2)
    return np.asarray(cross @ vector / np.sqrt(np.maximum(value, 1e-9)))


def _complex(columns: np.ndarray) -> np.ndarray:
    """(4 N, 2 K) real: complex whitened columns (N, 2, K) and i times the columns, each with half the variance."""
    z = columns.reshape(-1, columns.shape[-1]) / np.sqrt(2)
    return np.block([[z.real, -z.imag], [z.imag, z.real]])


def by_stimulus(model: Model, functions: np.ndarray) -> np.ndarray:
    """Functions (N, K) of the lines as functions (N, K J) of each of the J stimuli of a joint model."""
    at = model.stimulus_at(len(functions))
    if at is None:
        return functions
    return np.concatenate([functions * (at == k)[:, None] for k in range(len(model.blocks))], axis=1)


def free_torques(fitted: Fitted, data: Data) -> list[Family]:
    """Free torques at every joint and at all of them, the lowest first, and free relative errors of what is measured.

    Torques under different stimuli are independent: what is unknown may depend on what moves the body. A sensor has
    the same error under all of them. With one measured angle a torque at the locked hip is none.
    """
    s = 2j * np.pi * data.f
    model, theta = fitted.model, fitted.theta
    A, b = system(model, theta, s)
    H = np.linalg.solve(A, b[..., None])[..., 0]
    reply = data.weight @ _replies(model, A, s)  # whitened
    lowest_first = tuple(reversed(model.rows))
    loop = np.abs(np.einsum("nij,nj->ni", active(model, theta, s), H)) + 0.1 * np.abs(b).max(axis=1, keepdims=True)
    y = fitted.response(data.f)
    out = []
    for length in LENGTHS:
        phi = smooth_functions(data.f, length)
        free = by_stimulus(model, phi)
        torque = {
            row: _complex(reply[:, :, k, None] * (loop[:, k, None] * free)[:, None, :])
            for k, row in enumerate(model.rows)
        }
        sensor = [
            _complex(data.weight[:, :, k, None] * (y[:, k, None] * phi)[:, None, :]) for k in range(model.n_outputs)
        ]
        variances = tuple(v**2 for v in SIZES)
        out += [Family(f"free {row} torque", (row,), torque[row], variances) for row in lowest_first]
        if len(lowest_first) > 1:
            together = np.concatenate([torque[row] for row in lowest_first], axis=1)
            out.append(Family(f"free {' and '.join(lowest_first)} torque", lowest_first, together, variances))
        out.append(Family("free sensor error", ("sensor",), np.concatenate(sensor, axis=1), variances))
    return out


def _replies(model: Model, A: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(N, Y, R) what is measured per unit of torque by row, but for the filters of the sensors."""
    inverse = np.linalg.inv(A)
    return output_matrices(model, s)[0] @ inverse if model.outputs else inverse


def plain_feedback(fitted: Fitted, data: Data) -> list[tuple[str, tuple[str, ...], np.ndarray]]:
    """(name, locations, whitened column (4 N,)) of all plain feedback paths, before selection."""
    s = 2j * np.pi * data.f
    model, theta = fitted.model, fitted.theta
    A, b = system(model, theta, s)
    H = np.linalg.solve(A, b[..., None])[..., 0]
    reply = _replies(model, A, s)
    rows, n = list(enumerate(model.rows)), model.n_outputs
    senses = dict(zip(model.angles, H.T, strict=True))
    second = slower(model, data.f)
    delays = [d * second for d in DELAYS_S]
    shapes = [(f"s^{n} e^(-{d:g} s)", s**n * np.exp(-d * s)) for n, d in product((-1, 0, 1, 2), delays)]
    shapes += [(f"mode {f0 / second:g} Hz", _mode(s, f0 / second)) for f0 in RESONANCES_HZ]
    corners = [tau * second for tau in (0.05, 0.2, 1.0, 4.0)]
    shapes += [(f"corner {1 / tau:g}/s", 1 / (tau * s + 1)) for tau in corners]
    named, columns = [], []
    for (k, row), (sense, z), (name, shape) in product(rows, senses.items(), shapes):
        named.append((f"{row} <- {name} {sense}", (row,)))
        columns.append(reply[:, :, k] * (shape * z)[:, None])
    scale = np.abs(b).max(axis=1)
    for (k, row), (name, shape) in product(rows, shapes[:16:4]):
        named.append((f"{row} <- {name} stimulus", (row,)))
        columns.append(reply[:, :, k] * (shape * scale)[:, None])
    y = fitted.response(data.f)
    for (i, j), order in product(product(range(n), range(n)), (-1, 0, 1, 2)):
        column = np.zeros_like(y)
        column[:, i] = s**order * y[:, j]
        measured = model.output_names
        named.append((f"measured {measured[i]} <- s^{order} {measured[j]}", ("sensor",)))
        columns.append(column)
    whitened = whiten(data.weight, np.stack(columns, axis=-1)).T
    return [(*names, column) for names, column in zip(named, whitened, strict=True)]


def _mode(s: np.ndarray, frequency: float) -> np.ndarray:
    """s^2 times a resonance of damping ratio 0.2."""
    w = 2 * np.pi * frequency
    return s**2 * w**2 / (s**2 + 0.4 * w * s + w**2)


def strange(
    candidates: Sequence[tuple[str, tuple[str, ...], np.ndarray]], known: np.ndarray, alike: float = 0.9
) -> list[tuple[str, tuple[str, ...], np.ndarray]]:
    """The candidates, as unit vectors, that are similar neither to the ``known`` unit vectors (4 N, K) nor to each
    other.

    ``candidates`` have columns with the base parameters already projected out; zero columns are dropped.
    """
    kept: list[tuple[str, tuple[str, ...], np.ndarray]] = []
    basis, count = np.empty((known.shape[1] + len(candidates), known.shape[0])), known.shape[1]
    basis[:count] = known.T
    for name, locations, column in candidates:
        length = np.linalg.norm(column)
        if not length > 0:
            continue
        unit = column / length
        if count and np.abs(basis[:count] @ unit).max() > alike:
            continue
        kept.append((name, locations, unit))
        basis[count] = unit
        count += 1
    return kept
