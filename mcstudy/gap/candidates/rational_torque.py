"""A torque of no known mechanism as a transfer function: a path of the loop with at most `MOST_POLES` poles.

The path adds the corrective torque G(s) x at one joint, where x is one of the angles or the stimulus:

    G(s) = K + B s + R / (s / w + 1) + (P + Q s / v) / ((s / v)^2 + 2 zeta s / v + 1)

With 0 poles it is K + B s, with 1 the first fraction is added, with 2 the second, with 3 both. The second has two real
poles where zeta > 1. So the degree of the numerator exceeds the number of poles by at most 1. A stiffness K or damping
B that is already a parameter of the model is left out, because no data can tell the two apart. The path is a part of
the model's table like every other one, so fits, derivatives and responses include it in closed loop, exactly. Derived.

The gains have zero-mean normal priors. Their standard deviation is a torque of `PROPORTION` of the active torque of
that joint: what is left by a mechanism that comes near is small in proportion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.polynomial import polynomial

from mcstudy.effect_library.generic import torque_unit
from mcstudy.fitting.arguments import Prior
from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import slower
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.joint import changed, members
from mcstudy.stance.response import active, replies, system

MOST_POLES = 3

PROPORTION = 0.3
"""Standard deviation of the torque of each gain, relative to the active torque of the joint."""

POLE_HZ = (1.5, 2.0)
"""Mean and standard deviation of the prior of w / 2 pi and v / 2 pi, Hz."""

DAMPING = (0.5, 0.5)
"""Mean and standard deviation of the prior of zeta."""

DAMPINGS = (0.03, 3.0)
"""Bounds of zeta."""

_CORNERS, _RATIOS = 20, (0.08, 0.25, 0.7, 1.5)
"""Number of frequencies, and damping ratios, at which start values are sought."""

_K, _B, _R, _P, _Q, _W, _V, _Z = (f"torque_{n}" for n in ("K", "B", "R", "P", "Q", "w", "v", "zeta"))


@dataclass(frozen=True)
class Path:
    """Where a torque acts and what it depends on.

    Attributes
    ----------
    row: a torque balance. sense: an angle, or "stimulus". linear: which of the gains K and B it has.
    """

    row: str
    sense: str
    linear: tuple[str, ...] = (_K, _B)

    def signal(self, H: np.ndarray, angles: Sequence[str]) -> np.ndarray:
        """What it senses, per unit of the stimulus, (N,), in the responses (N, R) of the body."""
        return np.ones(len(H), dtype=complex) if self.sense == "stimulus" else H[:, list(angles).index(self.sense)]

    def unit(self, model: Model) -> str:
        """Unit of its transfer function; empty where that of the row is unknown."""
        torque = torque_unit(model)
        sensed = f"({model.stimulus_unit})" if self.sense == "stimulus" else model.unit
        return f"{torque}/{sensed}" if torque else ""

    def gains(self, poles: int) -> tuple[str, ...]:
        """Names of the gains with so many poles."""
        return (*self.linear, *((_R,) if poles % 2 else ()), *((_P, _Q) if poles > 1 else ()))

    def names(self, poles: int) -> tuple[str, ...]:
        """Names of all parameters that it adds, the gains first."""
        return (*self.gains(poles), *((_W,) if poles % 2 else ()), *((_V, _Z) if poles > 1 else ()))

    def basis(self, poles: int, shape: Sequence[float] | np.ndarray, s: np.ndarray) -> np.ndarray:
        """Transfer function of every gain, (N, gains); ``shape``: w, or v and zeta, or all three, each one or (N,)."""
        columns = [{_K: np.ones_like(s), _B: s}[name] for name in self.linear]
        if poles % 2:
            columns.append(1 / (s / shape[0] + 1))
        if poles > 1:
            v, zeta = shape[-2:]
            below = (s / v) ** 2 + 2 * zeta * s / v + 1
            columns += [1 / below, s / v / below]
        return np.array(columns).T.reshape(s.size, -1)

    def transfer(self, poles: int, added: np.ndarray, f: np.ndarray) -> np.ndarray:
        """G (N,) at frequencies in Hz; ``added``: the parameters of `names`."""
        n = len(self.gains(poles))
        return np.asarray(self.basis(poles, added[n:], 2j * np.pi * f) @ added[:n])

    def fraction(self, poles: int, added: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numerator and denominator of G as polynomials in ascending powers of s; the denominator begins with 1."""
        g, multiply, add = dict(zip(self.names(poles), added, strict=True)), polynomial.polymul, polynomial.polyadd
        first = np.array([1.0, 1 / g[_W]]) if poles % 2 else np.ones(1)
        second = np.array([1.0, 2 * g[_Z] / g[_V], g[_V] ** -2.0]) if poles > 1 else np.ones(1)
        below = multiply(first, second)
        above = multiply(np.array([g.get(_K, 0.0), g.get(_B, 0.0)]), below)
        if poles % 2:
            above = add(above, g[_R] * second)
        if poles > 1:
            above = add(above, multiply(np.array([g[_P], g[_Q] / g[_V]]), first))
        return np.asarray(above), np.asarray(below)


def paths(model: Model) -> tuple[Path, ...]:
    """Every row with any angle and, in a model with one stimulus, with the stimulus."""
    senses = (*model.angles, *(() if model.blocks else ("stimulus",)))
    return tuple(Path(r, x, _linear(model, r, x)) for r, x in product(model.rows, senses))


def _linear(model: Model, row: str, sense: str) -> tuple[str, ...]:
    """Which of K and B no parameter of the model is."""
    held = {
        t.order
        for t in members(model)[0].terms
        if t.row == row
        and model.senses[t.sense] == model.senses[sense]
        and len(t.gain) == 1
        and not (t.delay or t.late)
        and not t.filters
    }
    return tuple(name for order, name in ((0, _K), (1, _B)) if order not in held)


@dataclass(frozen=True)
class Loop:
    """The closed loop of a fit at N lines, per unit of the stimulus.

    Attributes
    ----------
    H: (N, R) angles of the body itself. torque: (N, R) complex, active torque by row. drive: (N,) largest torque of the
        stimulus itself. reply: (N, Y, R), what is measured per unit of torque by row.
    """

    H: np.ndarray
    torque: np.ndarray
    drive: np.ndarray
    reply: np.ndarray

    @classmethod
    def of(cls, fitted: Fitted, f: np.ndarray) -> Loop:
        """At frequencies (N,) in Hz."""
        s = 2j * np.pi * f
        A, b = system(fitted.model, fitted.theta, s)
        H = np.linalg.solve(A, b[..., None])[..., 0]
        torque = np.einsum("nij,nj->ni", active(fitted.model, fitted.theta, s), H)
        return cls(H, torque, np.abs(b).max(axis=1), replies(fitted.model, fitted.theta, s, A))

    def change(self, path: Path, model: Model) -> np.ndarray:
        """(N, Y) change of what is measured per unit of the transfer function of a path, to first order."""
        k = model.rows.index(path.row)
        return np.asarray(-self.reply[:, :, k] * path.signal(self.H, model.angles)[:, None])

    def scale(self, path: Path, model: Model) -> float:
        """Median over the lines of the torque of the row per unit of what the path senses.

        It is the active torque and a tenth of that of the stimulus, as of `mcstudy.gap.candidates.free_deviations`.
        """
        torque = np.abs(self.torque[:, model.rows.index(path.row)]) + 0.1 * self.drive
        return float(np.median(torque / np.maximum(np.abs(path.signal(self.H, model.angles)), 1e-300)))


def extended(fitted: Fitted, path: Path, poles: int, f: np.ndarray, scale: float) -> tuple[Model, Prior]:
    """The model of a fit with such a path, and its prior. ``scale``: `Loop.scale`; ``f``: (N,) lines, Hz."""
    w0 = _middle(f)
    sd = {_K: 1.0, _B: 1 / w0, _R: 1.0, _P: 1.0, _Q: 1.0}
    low, high = np.pi * f.min(), 3 * np.pi * f.max()
    centre, spread = (2 * np.pi * x / slower(fitted.model, f) for x in POLE_HZ)
    unit = path.unit(fitted.model)
    added, mean, width = [], [], []
    for name in path.names(poles):
        if name in sd:
            s = PROPORTION * scale * sd[name]
            added.append(Parameter(name, unit + (" s" if name == _B else ""), 0.0, -30 * s, 30 * s))
            mean.append(0.0)
            width.append(s)
        elif name == _Z:
            added.append(Parameter(name, "", DAMPING[0], *DAMPINGS))
            mean.append(DAMPING[0])
            width.append(DAMPING[1])
        else:
            at = float(np.clip(centre, low, high))
            added.append(Parameter(name, "rad/s", at, low, high))
            mean.append(at)
            width.append(spread)
    model = changed(fitted.model.with_terms(parameters=added), lambda m: _with_terms(m, path, poles))
    prior = fitted.prior
    return model, prior._replace(
        mean=np.concatenate([prior.mean, mean]), scale=np.concatenate([prior.scale, np.array(width)])
    )


def _with_terms(model: Model, path: Path, poles: int) -> Model:
    """The terms of the path; a corrective torque counts against the stimulus, like a stiffness."""
    filters: list[Filter] = []
    terms = [Term(path.row, path.sense, (name,), int(name == _B)) for name in path.linear]
    s, unity, square = Monomial(1.0, 1), Monomial(1.0, 0, ((_W, 1),)), Monomial(1.0, 0, ((_V, 2),))
    if poles % 2:
        filters.append(Filter("torque_first", (unity,), (s, unity)))
        terms.append(Term(path.row, path.sense, (_R,), filters=("torque_first",)))
    if poles > 1:
        below = (Monomial(1.0, 2), Monomial(2.0, 1, ((_V, 1), (_Z, 1))), square)
        rate = Monomial(1.0, 1, ((_V, 1),))
        filters += [Filter("torque_second", (square,), below), Filter("torque_second_rate", (rate,), below)]
        terms.append(Term(path.row, path.sense, (_P,), filters=("torque_second",)))
        terms.append(Term(path.row, path.sense, (_Q,), filters=("torque_second_rate",)))
    if path.sense == "stimulus":  # the sense weighs it with -1
        terms = [Term(t.row, t.sense, t.gain, t.order, filters=t.filters, coefficient=-1.0) for t in terms]
    return model.with_terms(terms=terms, filters=filters)


def linear_start(fitted: Fitted, path: Path) -> np.ndarray:
    """Start values (P,) of the fit without poles: that of the mechanism, without a torque."""
    return np.append(fitted.theta, np.zeros(len(path.linear)))


def next_starts(
    fitted: Fitted, known: int, path: Path, poles: int, data: Data, scale: float, most: int
) -> list[np.ndarray]:
    """Start values (P,), at most ``most``, of a fit with one fraction more.

    From the linearised model at a fit with ``poles``: for given poles the gains of a further fraction are linear, and
    their evidence has a closed form. ``known``: number of parameters without the torque. Either fraction that the fit
    lacks may be the new one; the number of poles follows from the length of a start.
    """
    unit = PROPORTION * scale
    J, residual = fitted.jacobian(data), fitted.free_residual(data)
    Q = np.linalg.qr(np.concatenate([J, np.diag(1 / fitted.prior.scale)]))[0][: J.shape[0]]
    through = np.einsum("nij,nj->ni", data.weight, Loop.of(fitted, data.f).change(path, fitted.model)) * unit
    new, out = Path(path.row, path.sense, ()), []
    for more in (1, 2):
        if poles + more > MOST_POLES or (more == 1 and poles % 2):
            continue
        tried, basis = _fractions(data.f.tobytes(), more)
        z = (through[:, :, None] * basis[:, None, :]).reshape(through.size, -1)
        columns = np.concatenate([z.real, z.imag])
        left = (columns - Q @ (Q.T @ columns)).T.reshape(len(tried), more, -1)
        gram = np.einsum("tid,tjd->tij", left, left) + np.eye(more)
        score = left @ residual
        mean = np.linalg.solve(gram, score[..., None])[..., 0]
        log = 0.5 * (mean * score).sum(axis=1) - 0.5 * np.linalg.slogdet(gram)[1]
        for c in np.argsort(-log)[:most]:
            step = columns[:, more * c : more * (c + 1)] @ mean[c]
            theta = fitted.theta - fitted.covariance @ (J.T @ step)
            added = dict(zip(path.names(poles), theta[known:], strict=True))
            added |= dict(zip(new.names(more), [*(mean[c] * unit), *tried[c]], strict=True))
            out.append(np.array([*theta[:known], *(added[n] for n in path.names(poles + more))]))
    return out


@lru_cache(maxsize=8)
def _fractions(f: bytes, poles: int) -> tuple[list[tuple[float, ...]], np.ndarray]:
    """Shapes of a fraction with 1 or 2 poles (T of them) that are tried, and their gains' transfer functions.

    These are (N, T poles) at the frequencies in ``f`` (float64, Hz).
    """
    hz = np.frombuffer(f)
    s, corners = 2j * np.pi * hz, np.geomspace(2 * np.pi * hz.min(), 2 * np.pi * hz.max(), _CORNERS)
    tried: list[tuple[float, ...]] = [(w,) for w in corners] if poles == 1 else list(product(corners, _RATIOS))
    every = Path("", "", ()).basis(poles, np.repeat(np.array(tried), s.size, axis=0).T, np.tile(s, len(tried)))
    return tried, every.reshape(len(tried), s.size, poles).swapaxes(0, 1).reshape(s.size, -1)


def _middle(f: np.ndarray) -> float:
    """Geometric mean of the lowest and the highest angular frequency, rad/s."""
    return float(2 * np.pi * np.sqrt(f.min() * f.max()))
