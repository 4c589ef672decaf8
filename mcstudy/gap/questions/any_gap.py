"""Whether there is a gap: the base fit, the signatures of all effects, and the tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.declare import Effect
from mcstudy.fitting.penalised import Data, Fitted, Fitter
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.candidates.signatures import Signature, ambiguity_groups, applicable, signatures
from mcstudy.gap.questions.contrasts import DRAWS as CONTRAST_DRAWS
from mcstudy.gap.questions.contrasts import Contrast, contrasts
from mcstudy.gap.questions.detection import Detection, detect
from mcstudy.lines.base_fit import base_fit
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.short_repr import Summary
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream

CONTRAST_SHARE = 0.1
"""Share of the significance level that the tests for amplitude dependence and drift use."""

MARGIN = 1.4
"""Factor on the p-value of the residual. The null samples include the random error of the covariance estimate but not
its bias, which reaches a tenth at some lines when the noise has another colour than sway. With this factor the
false-alarm rate stays below 5 % for every kind of data in ``pipelines/gap_challenge_robust.toml``; without it the rate
is 4 to 7 %."""


@dataclass(frozen=True, repr=False)
class GapTest(Summary):
    """Test of the lines of a recording against the base model.

    Attributes
    ----------
    data: the lines as fitted. base: best fit of the model without effects. minima: (K, P) lowest minima of its cost.
    effects: candidate effects. signatures: the residual that each would leave. groups: effects that these data cannot
        distinguish. scores: scores of any residual at this fit. detection, contrasts: the tests.
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
            ("squared residual", f"{d.chi2:.0f}, expected from noise alone {d.expected_chi2:.0f}"),
            ("lines", str(self.data.f.size)),
            ("effects", f"{len(self.effects)} tested, in {len(self.groups)} distinguishable groups"),
        ]

    @property
    def p_value(self) -> float:
        """p-value of any gap. It combines the residual, with its margin, and the contrasts, each with its share."""
        own = [c.p_value for c in self.contrasts if c.changes]
        share = CONTRAST_SHARE / max(1, len(own))
        return float(min(1.0, self._of_residual(self.detection.p_value), *(p / share for p in own)))

    @property
    def p_least(self) -> float:
        """Smallest `p_value` that the residual can give with this number of null samples."""
        return self._of_residual(1 / (1 + self.detection.draws))

    def _of_residual(self, p: float) -> float:
        share = CONTRAST_SHARE if any(c.changes for c in self.contrasts) else 0.0
        return MARGIN * p / (1 - share)


def gap_test(
    lines: Lines, nominal: Model, draws: int, refits: bool, seed: int, contrast_draws: int = CONTRAST_DRAWS
) -> GapTest:
    """Fit the base model and test it.

    ``nominal``: base model with values of the order of magnitude of a person's. ``draws``: number of null samples.
    ``refits``: refit the model to every null sample instead of using the linearised fit. ``contrast_draws``: null
    samples of every contrast; only p-values depend on them.
    """
    data, model = Data.of(lines), opened(nominal)
    fitter = Fitter(model, weak_prior(model, model), data.f)
    base, minima = base_fit(fitter, data, seed)
    effects = applicable(model)
    found = signatures(base, data, effects)
    scores = Scores(base, data, found, [library.effect(s.effect).size.signed for s in found])
    return GapTest(
        data,
        base,
        minima,
        effects,
        found,
        ambiguity_groups(found),
        scores,
        detect(base, fitter, data, lines, scores, stream(seed, "gap null"), draws, refits),
        contrasts(lines, base, stream(seed, "gap contrasts"), contrast_draws),
    )
