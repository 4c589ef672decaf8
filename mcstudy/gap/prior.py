"""Prior probabilities of no missing effect, of effects of the library, and of causes outside it."""

from __future__ import annotations

import numpy as np

from mcstudy.errors import InputError

NONE = 0.30
"""Prior probability that no effect is missing: an assumption, no measurement of real bodies.

It equals the share of cases without a missing effect in the benchmark of the diagnosis (pipelines/gap_challenge.toml),
whose calibration is therefore that of a prior that is right. ``--prior-none`` replaces it; a score of the
benchmark says what the same answers are worth where the share is 0.1 or 0.5 (`other_shares`).
"""

SINGLE, PAIR, UNKNOWN, BESIDE = 0.52, 0.03, 0.11, 0.04
"""Prior probabilities of the other kinds of hypotheses (`MEANINGS`): assumptions as well.

One effect is taken to be most likely by far, two at once and a cause beside an effect to be rare, and a cause outside
the library to be a fifth as likely as one in it.
"""

MEANINGS = {
    "none": "no missing effect",
    "single": "one effect of the library",
    "pair": "two effects",
    "unknown": "a cause outside the library",
    "beside": "such a cause beside an effect",
}
"""Kinds of hypotheses with a prior probability, in words."""


def prior(none: float = NONE) -> dict[str, float]:
    """Prior probability of each of `MEANINGS`, with ``none`` that of no missing effect; the others keep their ratios.

    Raises `InputError` unless it is above 0 and below 1.
    """
    if not (isinstance(none, int | float) and 0 < none < 1):
        raise InputError(f"prior_none: expected a probability above 0 and below 1, got {none!r}")
    others = np.array([SINGLE, PAIR, UNKNOWN, BESIDE]) * ((1 - none) / (1 - NONE))
    return dict(zip(MEANINGS, (float(none), *others.tolist()), strict=True))
