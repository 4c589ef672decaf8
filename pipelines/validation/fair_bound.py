"""The oracle bound of a method that must also expect causes outside the library and two causes at once.

The oracle bound in a key (`mcstudy_challenge.scores.oracle`) knows that a case has no effect or one of the library. The
ideal method here knows the shares of all kinds of the challenge instead: nothing missing, one effect, an out-of-library
effect (in the directions that those of the challenge have on this body), and two effects (every pair of groups). It
still knows the noise, the body, all directions and the distribution of sizes. Derived.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from mcstudy_challenge.bodies.draws import draw_body, draw_delta, shared
from mcstudy_challenge.bodies.geometry import Geometry, free
from mcstudy_challenge.bodies.out_of_library import OUT_OF_LIBRARY
from mcstudy_challenge.bodies.withheld_causes import out_of_library_on
from mcstudy_challenge.design import NOTHING_MISSING, Series
from mcstudy_challenge.scores.oracle import Ceiling, Classifier, size_grid
from mcstudy_challenge.truth import Surroundings, classifier

from mcstudy.effect_library import library
from mcstudy.stance.body import two_segment

POINTS = 6
"""Sizes for each stratum of delta."""

PAIR_DRAWS = 3
"""Draws of sizes and signatures for each pair of groups."""

REACH = 1.25
"""A drawn pair stands for all sizes within this factor."""


@dataclass(frozen=True)
class Ideal:
    """Two ideal methods on one body.

    Attributes
    ----------
    around: signatures of the library. narrow: expects no effect or one of the library. fair: knows the shares of all
        kinds of the challenge; its first signatures and groups are those of ``narrow``.
    """

    around: Surroundings
    narrow: Classifier
    fair: Classifier

    def figures(self, rng: np.random.Generator, delta: float, draws: int) -> tuple[Ceiling, Ceiling]:
        """Mean figures of ``narrow`` and ``fair`` over the effects of the library, each at ``delta``."""
        columns = self.around.columns
        each = [sum(c.effect == other.effect for other in columns) for c in columns]
        weight = 1.0 / np.array(each)
        means = []
        for method in (self.narrow, self.fair):
            threshold = method.threshold(rng, 10 * draws)
            found = []
            for k, column in enumerate(columns):
                near = set(self.around.similar_to(column.effect))
                similar = [i for i, g in enumerate(self.around.groups) if set(g) & near]
                found.append(method.ceiling(rng, k, delta, similar, draws, threshold).rounded())
            means.append(Ceiling(**{k: float(np.average([f[k] for f in found], weights=weight)) for k in found[0]}))
        return means[0], means[1]


def ideal(series: Series, rng: np.random.Generator) -> Ideal:
    """The ideal methods on a drawn body; out-of-library effects are those that it can stand with."""
    setting, probes = shared(series)
    geometry = Geometry(free(two_segment()), draw_body(series, rng, False), setting, series.noise.sensor)
    around = Surroundings.of(geometry, probes)
    narrow = classifier(series, around)
    delta, weight = size_grid(series.sizes.strata, POINTS)
    units = [c.unit for c in around.columns]
    groups, shares = list(narrow.group), list(narrow.share)
    sizes, weights = [delta] * len(units), [weight] * len(units)
    outside = _outside(series, rng, geometry)
    for unit, scale in outside:
        units.append(unit)
        sizes.append(scale * delta)
        weights.append(weight)
        groups.append(len(around.groups))
        shares.append(1 / len(outside))
    steps = REACH ** np.linspace(-1, 1, delta.size)
    number = len(around.groups) + 1
    for first, second in combinations(range(len(around.groups)), 2):
        drawn = _pairs(series, rng, around, first, second)
        for x in drawn:
            size = float(np.linalg.norm(x))
            units.append(x / size)
            sizes.append(size * steps)
            weights.append(np.full(delta.size, 1 / delta.size))
            groups.append(number)
            shares.append(1 / len(drawn))
        number += bool(drawn)
    pairs = number - len(around.groups) - 1
    mix = series.mix
    nothing = sum(mix.of(k) for k in NOTHING_MISSING)
    named = mix.known * narrow.prior[1:] / narrow.prior[1:].sum()
    prior = np.array([nothing, *named, mix.outsider, *[mix.pair / max(pairs, 1)] * pairs])
    S = np.column_stack(units)
    fair = Classifier(
        S.T @ S, np.array(groups), np.maximum(prior, 1e-300) / prior.sum(), np.array(shares), np.array(sizes),
        np.array(weights),
    )  # fmt: skip
    return Ideal(around, narrow, fair)


def _outside(series: Series, rng: np.random.Generator, geometry: Geometry) -> list[tuple[np.ndarray, float]]:
    """Direction of every out-of-library effect, and its whole residual relative to the delta that defines its size."""
    found = []
    for name in series.sizes.outsiders or tuple(OUT_OF_LIBRARY):
        measured = out_of_library_on(geometry, name, draw_delta(series, rng))
        if measured is not None:
            x = geometry.unexplained(measured.response)
            found.append((x / np.linalg.norm(x), float(np.linalg.norm(x)) / measured.delta))
    return found


def _pairs(series: Series, rng: np.random.Generator, around: Surroundings, first: int, second: int) -> list[np.ndarray]:
    """Residuals of two effects, one of each group; none where both stand for one cause."""
    own = [[c for c in around.columns if c.effect in around.groups[g]] for g in (first, second)]
    drawn = []
    for _ in range(PAIR_DRAWS):
        a, b = (columns[int(rng.integers(len(columns)))] for columns in own)
        if library.effect(a.effect).cause != library.effect(b.effect).cause:
            drawn.append(draw_delta(series, rng) * a.unit + draw_delta(series, rng) * b.unit)
    return drawn
