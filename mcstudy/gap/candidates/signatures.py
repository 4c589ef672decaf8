"""Signatures: the residual that every effect of the library would leave after the base model has been refitted.

A *signature* is a whitened residual, computed at a finite size of the effect. The parameters of the model absorb the
derivative of some effects (a low-pass on delayed feedback), which are then visible only through their curvature. The
length of a signature is *delta*, the square root of the noncentrality: the expected value, in standard deviations, of
the best test for that effect. A recording cannot distinguish two effects whose signatures have |cosine| above `ALIKE`;
they form one ambiguity group. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect
from mcstudy.effect_library.library import Library
from mcstudy.errors import ModelError
from mcstudy.fitting.penalised import Fitted, Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.lines.priors import weak_prior
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian

ALIKE = 0.95
"""|cosine| of two signatures above which their effects form one ambiguity group."""

WANTED = 6.0
"""Delta at which signatures are computed, or the closest that the bounds of the effect allow."""


ROUNDS = 12
"""Most steps of the path to the wanted delta."""


@dataclass(frozen=True)
class Signature:
    """One effect at one size (and one value of its shape parameters).

    Attributes
    ----------
    effect: its name. sizes: value per parameter it adds. vector: (4 N,) whitened residual after refitting the base.
    shift: (P,) change of the base parameters when the effect is left out.
    """

    effect: str
    sizes: dict[str, float]
    vector: np.ndarray
    shift: np.ndarray

    @property
    def delta(self) -> float:
        """Root of the noncentrality."""
        return float(np.linalg.norm(self.vector))


def applicable(base: Model) -> list[Effect]:
    """Linear effects of the library that can be added to the base model."""
    out = []
    for e in library.library_of(base).values():
        if e.kind != "linear":
            continue
        try:
            library.apply(base, e.name)
        except ModelError:
            continue
        out.append(e)
    return out


def _cases(effect: Effect) -> list[tuple[dict[str, float], float]]:
    """(shape parameters, limit of the size): both signs if people have both, three values per shape parameter."""
    first, *shapes = effect.sizes
    grids: list[dict[str, float]] = [{}]
    for c in shapes:
        low, high = c.published
        grids = [{**g, c.name: v} for g in grids for v in (low, (low + high) / 2, high)]
    limits = (first.upper, first.lower) if first.signed else (first.upper,)
    return [(g, b) for g in grids for b in limits]


def signatures(fitted: Fitted, data: Data, effects: Sequence[Effect]) -> list[Signature]:
    """Signatures of effects around a fit of the base model, at sizes with a delta near `WANTED`.

    The effect is fixed at a size and the base parameters are refitted to the noise-free base response. The residual is
    the part of the effect that the base parameters cannot compensate. (The opposite, adding the effect to the fitted
    body, would often give an unstable body.) Sizes increase from small ones, and every fit starts at the extrapolation
    of the last two, so that the path stays among stable bodies.
    """
    base = fitted.model
    clean = data.with_y(fitted.response(data.f))
    rest = Fitter(base, weak_prior(base, base), data.f).best(clean, fitted.theta)
    return [s for e in effects for s in _walk(e, fitted, rest, clean)]


def _walk(e: Effect, fitted: Fitted, rest: Fitted, clean: Data) -> list[Signature]:
    """Signatures of one effect, with every sign and value of the shape parameters in a lane of its own."""
    base, P = fitted.model, fitted.theta.size
    model = library.apply(base, e.name)
    fitter = Fitter(model, weak_prior(model, base), clean.f)
    cases = _cases(e)
    at_null = {s.name: s.parameter.value for s in e.sizes}
    start = np.array([[*rest.theta, *({**at_null, **c}[s.name] for s in e.sizes)] for c, _ in cases])
    limit = np.array([b for _, b in cases])
    slope = np.empty((len(cases), P))
    first = np.empty(len(cases))
    at_rest, covariance = rest.response(clean.f), rest.covariance
    for k, derivative in enumerate(frf_jacobian(fitter.model, start, clean.f)[1]):
        J = whiten(clean.weight, derivative)
        slope[k] = -covariance @ (J[:, :P].T @ J[:, P])
        left = float(np.linalg.norm(J[:, P] + J[:, :P] @ slope[k]))
        first[k] = np.sign(limit[k]) * min(abs(limit[k]), WANTED / max(left, 1e-300)) / 8
    previous_size, previous = np.zeros(len(cases)), start[:, :P].copy()
    size, guess = first, start[:, :P] + first[:, None] * slope
    best: list[Signature | None] = [None] * len(cases)
    for _ in range(ROUNDS):
        x = start.copy()
        x[:, :P], x[:, P] = guess, size
        lower, upper = (np.tile(b, (len(cases), 1)) for b in (fitter.model.lower, fitter.model.upper))
        lower[:, P:] = upper[:, P:] = x[:, P:]
        fits = fitter.fits(fitter.packed(clean), x, lower=lower, upper=upper)
        grow = np.empty(len(cases))
        changes = frf(fitter.model, fits.estimate, clean.f) - at_rest
        for k, theta in enumerate(fits.estimate):
            vector = whiten(clean.weight, changes[k])
            sizes = {**cases[k][0], e.size.name: float(size[k])}
            signature = Signature(e.name, sizes, vector, rest.theta - theta[:P])
            before = best[k]
            if before is None or abs(signature.delta - WANTED) < abs(before.delta - WANTED):
                best[k] = signature
            grow[k] = np.clip(WANTED / max(signature.delta, 1e-9), 1.0, 2.0)
        grow = np.minimum(grow, np.abs(limit / size))
        if (grow < 1.2).all():
            break
        step = fits.estimate[:, :P] - previous
        rate = step / (size - previous_size)[:, None]
        previous_size, previous = size, fits.estimate[:, :P].copy()
        size = size * grow
        guess = previous + rate * (size - previous_size)[:, None]
        size = np.where(grow > 1.0, size, previous_size * (1 + 1e-9))
    return [s for s in best if s is not None]


def similarity(
    effects: Sequence[str], unit: np.ndarray, known: Library = library.LIBRARY
) -> tuple[list[str], np.ndarray]:
    """Names (E of them), and the largest |cosine| between any of their signatures, (E, E).

    ``effects``: (K,) name of the effect of each unit signature in ``unit`` (K, M). Variants of one cause in the library
        ``known`` have similarity 1.
    """
    names = list(dict.fromkeys(effects))
    if not names:
        return [], np.zeros((0, 0))
    cosine = np.abs(unit @ unit.T)
    owner = np.array([names.index(e) for e in effects])
    out = np.eye(len(names))
    for i, a in enumerate(names):
        for j, b in enumerate(names[:i]):
            same = known[a].cause == known[b].cause
            out[i, j] = out[j, i] = 1.0 if same else cosine[np.ix_(owner == i, owner == j)].max()
    return names, out


def alike_groups(names: Sequence[str], cosine: np.ndarray, threshold: float = ALIKE) -> list[tuple[str, ...]]:
    """Connected sets of effects with |cosine| above the threshold, including sets of one."""
    if not names:
        return []
    linked = (cosine > threshold) | np.eye(len(names), dtype=bool)
    while not np.array_equal(further := linked @ linked, linked):  # boolean: whatever is linked by way of another
        linked = further
    return [tuple(names[int(i)] for i in np.flatnonzero(row)) for k, row in enumerate(linked) if row.argmax() == k]


def ambiguity_groups(shapes: Sequence[Signature], known: Library = library.LIBRARY) -> list[tuple[str, ...]]:
    """Sets of effects whose signatures this recording cannot distinguish."""
    unit = np.array([s.vector / max(s.delta, 1e-300) for s in shapes])
    return alike_groups(*similarity([s.effect for s in shapes], unit, known)) if len(shapes) else []
