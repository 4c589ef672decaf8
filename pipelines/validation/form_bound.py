"""What an ideal method could reach where a mechanism has another form than the library declares.

The ideal method knows the covariance of the noise, the body, the distribution of forms from which the challenge draws
(`mcstudy_challenge.bodies.forms`), the distribution of sizes, and that exactly one mechanism is missing. Its evidence
for a mechanism is the mean likelihood over drawn forms. A form is a whitened residual x (4 N,) after a refit of the
base model; for data z of unit variance its likelihood ratio is exp(d u'z - d^2 / 2) with u = x / |x|, averaged over
sizes d within a factor `REACH` of |x|. Derived.

The true form is never exactly among finitely many draws. The performance therefore lies between two limits. Without the
true form among the draws, the method is a real classifier, and no better than the ideal one; the limit rises with the
number of draws. With the true form among them it is better. Forms that are rules of the time-domain simulator have no
direction in the mean response and are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mcstudy_challenge.bodies.draws import draw_body, shared
from mcstudy_challenge.bodies.forms import FORMS
from mcstudy_challenge.bodies.geometry import Geometry, free
from mcstudy_challenge.bodies.other_forms import linear_form
from mcstudy_challenge.design import Series
from mcstudy_challenge.truth import Surroundings
from scipy.special import logsumexp

from mcstudy.stance.body import two_segment

REACH = 1.4
"""A form stands for all sizes within this factor."""

STEPS = 9
"""Number of sizes over which a likelihood is averaged."""

SAMPLES = 8
"""Samples of noise per truth."""


@dataclass(frozen=True)
class Imagined:
    """Forms drawn on one body, D of them.

    Attributes
    ----------
    form, mechanism: (D,) names. residual: (D, 4 N) whitened residuals. right: for each mechanism the names that count
        as right, as in a key.
    """

    form: tuple[str, ...]
    mechanism: tuple[str, ...]
    residual: np.ndarray
    right: dict[str, frozenset[str]]

    @property
    def delta(self) -> np.ndarray:
        """(D,) delta of every draw."""
        return np.asarray(np.linalg.norm(self.residual, axis=1))

    @property
    def share(self) -> np.ndarray:
        """(D,) probability of each draw: every mechanism, every form of it and every draw of that has the same."""
        forms = {m: {f for f, n in zip(self.form, self.mechanism, strict=True) if n == m} for m in self.right}
        each = [1 / self.form.count(f) / len(forms[m]) for f, m in zip(self.form, self.mechanism, strict=True)]
        return np.array(each) / len(self.right)


def imagine(series: Series, rng: np.random.Generator, draws: int) -> Imagined:
    """Forms drawn on a drawn body as the challenge draws them, ``draws`` of every linear form (fewer where a body that
    stands does not reach the drawn delta)."""
    setting, probes = shared(series)
    geometry = Geometry(free(two_segment()), draw_body(series, rng, False), setting, series.noise.sensor)
    around = Surroundings.of(geometry, probes)
    names, rows = [], []
    for form in FORMS.values():
        if form.build is None or (series.sizes.forms and form.name not in series.sizes.forms):
            continue
        for _ in range(draws):
            measured = linear_form(series, rng, form, geometry, form.draw(rng))
            if measured is not None:
                names.append(form.name)
                rows.append(geometry.unexplained(measured.response))
    mechanism = [FORMS[n].mechanism for n in names]
    right = {m: frozenset((*around.group(m), *around.similar_to(m))) for m in dict.fromkeys(mechanism)}
    return Imagined(tuple(names), tuple(mechanism), np.array(rows), right)


@dataclass(frozen=True)
class Reached:
    """How often the ideal method has a right mechanism first (``top``), its mean probability of the right ones, and how
    often its 95 % set holds one; (D,) each, one value per drawn truth."""

    top: np.ndarray
    probability: np.ndarray
    covered: np.ndarray


def reached(drawn: Imagined, rng: np.random.Generator, own: bool) -> Reached:
    """Performance with each draw as the truth in turn. ``own``: the true form is a hypothesis too, else left out."""
    delta = drawn.delta
    value, vector = np.linalg.eigh(drawn.residual @ drawn.residual.T)
    x = vector * np.sqrt(np.maximum(value, 0.0))  # the draws span a space of at most D dimensions
    unit = x / delta[:, None]
    sizes = (delta * REACH ** np.linspace(-1, 1, STEPS)[:, None])[:, None]
    names, forms = list(drawn.right), sorted(set(drawn.form))
    index = np.array([names.index(m) for m in drawn.mechanism])
    form = np.array([forms.index(f) for f in drawn.form])
    rows = []
    for k, mechanism in enumerate(drawn.mechanism):
        kept = np.full(len(x), True)
        kept[k] = own
        z = (x[k] + rng.standard_normal((SAMPLES, len(x)))) @ unit[kept].T
        likelihood = logsumexp(z * sizes[..., kept] - sizes[..., kept] ** 2 / 2, axis=0)
        log = likelihood + np.log(_prior(form[kept], index[kept]))
        by_name = np.full((SAMPLES, len(names)), -np.inf)
        for m in np.unique(index[kept]):
            by_name[:, m] = logsumexp(log[:, index[kept] == m], axis=1)
        p = np.exp(by_name - logsumexp(by_name, axis=1)[:, None])
        rows.append(_graded(p, [n in drawn.right[mechanism] for n in names]))
    return Reached(*np.array(rows).T)


def _prior(form: np.ndarray, mechanism: np.ndarray) -> np.ndarray:
    """Probability of every hypothesis (M,): equal for mechanisms, for the forms of one, for the hypotheses of one."""
    out = np.empty(form.size)
    for m in np.unique(mechanism):
        forms = np.unique(form[mechanism == m])
        for f in forms:
            out[form == f] = 1 / forms.size / (form == f).sum()
    return out / out.sum()


def _graded(p: np.ndarray, right: Sequence[bool]) -> tuple[float, float, float]:
    """Shares (top, mean probability, covered) of posteriors (samples, mechanisms)."""
    true = p[:, np.array(right)].sum(axis=1)
    wrong = p[:, ~np.array(right)]
    before = np.where(wrong > true[:, None], wrong, 0.0).sum(axis=1)
    return float((true > wrong.max(axis=1, initial=0.0)).mean()), float(true.mean()), float((before < 0.95).mean())
