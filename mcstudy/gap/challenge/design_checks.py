"""What only the library and the physics can tell is wrong with a series of a challenge file."""

from __future__ import annotations

import numpy as np

from mcstudy.errors import DesignError, InputError
from mcstudy.gap import effects as library
from mcstudy.gap.challenge.design import Series
from mcstudy.gap.outsiders import OUTSIDERS
from mcstudy.spectra.bands import odd_lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.stimulus import Prts
from mcstudy.study.checks import MAX_SAMPLES, check_determined, check_fmax
from mcstudy.study.measure import HIGHEST_HZ


def check(series: Series) -> None:
    """Raise `DesignError` for the first thing that is wrong; its message starts with the field within the series."""
    for name in series.sizes.effects:
        try:
            library.effect(name)
        except InputError as error:
            raise DesignError(f"sizes.effects: {error}") from None
    for name in series.sizes.outsiders:
        if name not in OUTSIDERS:
            raise DesignError(f"sizes.outsiders: expected one of {', '.join(OUTSIDERS)}, got {name!r}")
    p, prts = series.protocol, Prts()
    samples = len(p.amplitudes) * p.cycles * prts.samples
    if samples > MAX_SAMPLES:
        raise DesignError(
            f"protocol.cycles: expected a recording of at most {MAX_SAMPLES} samples, "
            f"got {len(p.amplitudes)} trials of {p.cycles} cycles of {prts.samples}"
        )
    points = odd_lines(HIGHEST_HZ, prts.period_s).f
    check_fmax(p.fmax, p.fmax, points, 0.5 / prts.period_s, "protocol.fmax")
    # Up to half a line above fmax, as `mcstudy.gap.challenge.geometry.Setting` takes them.
    taken = int(np.sum(points <= p.fmax + 0.5 / prts.period_s))
    check_determined(taken, two_segment(), p.fmax, "protocol.fmax")
