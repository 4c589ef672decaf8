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
from mcstudy.gap.signatures import Signature, ambiguity_groups, signatures, usable
from mcstudy.gap.summary import Summary
from mcstudy.stance.feedback import Model
from mcstudy.study.streams import stream

CONTRAST_SHARE = 0.1
"""Share of the level that is spent on amplitude dependence and drift."""

MARGIN = 1.4
"""Factor on the p-value of the residual. Draws of the null know how uncertain the covariance is, not where its estimate
is off on average: by up to a tenth at some lines when the noise has another colour than sway. With it the false alarms
stay below 5 % for every kind of data in ``pipelines/gap_challenge_robust.toml``; without it they are 4 to 7 %."""


@dataclass(frozen=True, repr=False)
class Tested(Summary):
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

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        d = self.detection
        return [
            ("p-value of any gap", f"{self.p_value:.2g}"),
            ("squared residual", f"{d.chi2:.0f}, noise alone expects {d.expected_chi2:.0f}"),
            ("lines", str(self.data.f.size)),
            ("effects", f"{len(self.effects)} tried, in {len(self.groups)} groups that can be told apart"),
        ]

    @property
    def p_value(self) -> float:
        """Of any gap: residual, with its margin, and contrasts, each with its share of the level."""
        own = [c.p_value for c in self.contrasts if c.changes]
        share = CONTRAST_SHARE / max(1, len(own))
        return float(min(1.0, self._of_residual(self.detection.p_value), *(p / share for p in own)))

    @property
    def p_least(self) -> float:
        """The least that the residual can make `p_value` with these draws."""
        return self._of_residual(1 / (1 + self.detection.draws))

    def _of_residual(self, p: float) -> float:
        share = CONTRAST_SHARE if any(c.changes for c in self.contrasts) else 0.0
        return MARGIN * p / (1 - share)


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
        ambiguity_groups(found),
        scores,
        detect(base, fitter, data, lines, scores, stream(seed, "gap null"), draws, refits),
        contrasts(lines, base, stream(seed, "gap contrasts")),
    )
