"""Checks of a series of a challenge file that need the effect library and the physics."""

from __future__ import annotations

import numpy as np

from mcstudy.effect_library import library
from mcstudy.errors import DesignError, InputError
from mcstudy.spectra.bands import odd_lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.ranges import MAX_SAMPLES
from mcstudy.stance.stimulus import Prts
from mcstudy.study.checks import check_determined, check_fmax
from mcstudy.study.group import HIGHEST_HZ
from mcstudy_challenge.bodies.foreign_effects import FOREIGN
from mcstudy_challenge.bodies.forms import FORMS
from mcstudy_challenge.bodies.out_of_library import OUT_OF_LIBRARY
from mcstudy_challenge.design import Series


def check_series(series: Series) -> None:
    """Raise `DesignError` for the first mistake; its message starts with the field within the series."""
    for name in series.sizes.effects:
        try:
            library.effect(name)
        except InputError as error:
            raise DesignError(f"sizes.effects: {error}") from None
    for name in series.sizes.outsiders:
        if name not in OUT_OF_LIBRARY:
            raise DesignError(f"sizes.outsiders: expected one of {', '.join(OUT_OF_LIBRARY)}, got {name!r}")
    for name in series.sizes.forms:
        if name not in FORMS:
            raise DesignError(f"sizes.forms: expected one of {', '.join(FORMS)}, got {name!r}")
    for name in series.sizes.foreign:
        if name not in FOREIGN:
            raise DesignError(f"sizes.foreign: expected one of {', '.join(FOREIGN)}, got {name!r}")
    p, prts = series.protocol, Prts()
    samples = len(p.amplitudes) * p.cycles * prts.samples
    if samples > MAX_SAMPLES:
        raise DesignError(
            f"protocol.cycles: expected a recording of at most {MAX_SAMPLES} samples, "
            f"got {len(p.amplitudes)} trials of {p.cycles} cycles of {prts.samples}"
        )
    points = odd_lines(HIGHEST_HZ, prts.period_s).f
    check_fmax(p.fmax, p.fmax, points, 0.5 / prts.period_s, "protocol.fmax")
    # Up to half a line above fmax, as `mcstudy_challenge.bodies.geometry.Setting` takes them.
    taken = int(np.sum(points <= p.fmax + 0.5 / prts.period_s))
    check_determined(taken, two_segment(), p.fmax, "protocol.fmax")
