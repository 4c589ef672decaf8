"""Whether there is a gap: the base fit, the signatures of all effects, and the tests."""

from __future__ import annotations

from dataclasses import dataclass

from mcstudy.effect_library import library
from mcstudy.effect_library.effect import Effect
from mcstudy.gap.candidates.scores import Scores
from mcstudy.gap.candidates.signatures import Signature, ambiguity_groups, applicable, signatures
from mcstudy.gap.questions.contrasts import DRAWS as CONTRAST_DRAWS
from mcstudy.gap.questions.contrasts import Contrast, contrasts
from mcstudy.gap.questions.detection import Detection, detect
from mcstudy.gap.settings import DiagnosisSettings
from mcstudy.lines.base_fit import BaseFit
from mcstudy.spectra.lines import Lines
from mcstudy.streams import stream

CONTRAST_SHARE = 0.1
"""Share of the significance level that the tests for amplitude dependence and drift use."""

MARGIN = 1.4
"""Factor on the p-value of the residual. The null samples include the random error of the covariance estimate but not
its bias, which reaches a tenth at some lines when the noise has another colour than sway. With this factor the
false-alarm rate stays below 5 % for every kind of data in ``pipelines/gap_challenge_robust.toml``; without it the rate
is 4 to 7 %."""


@dataclass(frozen=True, repr=False)
class GapTest:
    """Test of the lines of a recording against the base model.

    Attributes
    ----------
    fit: of the model without effects. effects: candidates. signatures: the residual that each of them would leave.
    groups: effects that these data cannot distinguish. scores: scores of any residual at this fit. detection,
    contrasts: the tests.
    """

    fit: BaseFit
    effects: list[Effect]
    signatures: list[Signature]
    groups: list[tuple[str, ...]]
    scores: Scores
    detection: Detection
    contrasts: list[Contrast]

    @property
    def p_value(self) -> float:
        """p-value of any gap. It combines the residual, with its margin, and the contrasts, each with its share."""
        changing = [c.p_value for c in self.contrasts if c.changes]
        share = CONTRAST_SHARE / max(1, len(changing))
        return float(min(1.0, self._of_residual(self.detection.p_value), *(p / share for p in changing)))

    @property
    def p_least(self) -> float:
        """Smallest `p_value` that the residual can give with this number of null samples."""
        return self._of_residual(1 / (1 + self.detection.draws))

    def _of_residual(self, p: float) -> float:
        share = CONTRAST_SHARE if any(c.changes for c in self.contrasts) else 0.0
        return MARGIN * p / (1 - share)


def gap_test(lines: Lines, fit: BaseFit, settings: DiagnosisSettings, contrast_draws: int = CONTRAST_DRAWS) -> GapTest:
    """Test the base model that was fitted to ``lines``.

    ``contrast_draws``: null samples of every contrast; only p-values depend on them.
    """
    base, data, seed = fit.best, fit.data, settings.seed
    effects, known = applicable(fit.model), library.library_of(fit.model)
    shapes = signatures(base, data, effects)
    scores = Scores(base, data, shapes, [known[s.effect].size.signed for s in shapes])
    rng = stream(seed, "gap null")
    return GapTest(
        fit=fit,
        effects=effects,
        signatures=shapes,
        groups=ambiguity_groups(shapes, known),
        scores=scores,
        detection=detect(base, fit.fitter, data, lines, scores, rng, settings.draws, not settings.fast),
        contrasts=contrasts(lines, base, stream(seed, "gap contrasts"), contrast_draws),
    )
