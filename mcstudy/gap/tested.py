"""A recording up to the question whether there is a gap: the base fit, what effects would leave, the tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.gap import effects as library
from mcstudy.gap.base_fit import base_fit
from mcstudy.gap.contrasts import Contrast, contrasts
from mcstudy.gap.declare import Effect
from mcstudy.gap.detect import Detection, detect
from mcstudy.gap.fitting import Data, Fitted, Fitter, opened
from mcstudy.gap.lines import Lines
from mcstudy.gap.scores import Scores
from mcstudy.gap.signatures import Signature, groups, likeness, signatures, usable
from mcstudy.stance.feedback import Model
from mcstudy.study.streams import stream

CONTRAST_SHARE = 0.1
"""Share of the level that is spent on amplitude dependence and drift."""


@dataclass(frozen=True)
class Tested:
    """A recording's lines under the base model, tested.

    Attributes
    ----------
    data: the lines as fitted. base: the best fit of the model without effects. minima: (K, P) its lowest minima.
    effects: what could be missing. signatures: what each would leave. groups: which cannot be told apart.
    scores: of any residual at this fit. detection, contrasts: the tests.
    """

    data: Data
    base: Fitted
    minima: np.ndarray
    effects: list[Effect]
    signatures: list[Signature]
    groups: list[tuple[str, ...]]
    scores: Scores
    detection: Detection
    contrasts: list[Contrast]

    @property
    def p_value(self) -> float:
        """Of any gap: residual and contrasts, each with its share of the level."""
        own = [c.p_value for c in self.contrasts if c.changes]
        if not own:
            return self.detection.p_value
        share = CONTRAST_SHARE / len(own)
        return float(min(1.0, self.detection.p_value / (1 - CONTRAST_SHARE), *(p / share for p in own)))


def tested(lines: Lines, nominal: Model, draws: int, refits: bool, seed: int) -> Tested:
    """Fit and test. ``nominal``: base model whose values are the order of magnitude of a person's; ``draws`` of the
    null, with the model refitted to each (``refits``) or through the linearised fit."""
    data, model = Data.of(lines), opened(nominal)
    fitter = Fitter(model, model, data.f)
    base, minima = base_fit(fitter, data, seed)
    effects = usable(model)
    found = signatures(base, data, effects)
    scores = Scores(base, data, found, [library.effect(s.effect).size.signed for s in found])
    return Tested(
        data,
        base,
        minima,
        effects,
        found,
        list(groups(*likeness(found))),
        scores,
        detect(base, fitter, data, lines, scores, stream(seed, "gap null"), draws, refits),
        contrasts(lines, base, stream(seed, "gap contrasts")),
    )
