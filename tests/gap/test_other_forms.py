"""A mechanism in another form than the declared one keeps its name, and its form is estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mcstudy_challenge.bodies.forms import FORMS
from mcstudy_challenge.bodies.misshapen import shaped

from mcstudy.effect_library import library
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.evidence import Hypothesis, single
from mcstudy.gap.questions.other_forms import in_other_forms, mixed
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

BASE = two_segment()
OPEN = opened(BASE)


@pytest.mark.parametrize(
    ("form", "size", "constants", "constant"),
    [
        ("acceleration_of_both_joints", 3.0, {"r": 0.3}, "ratio_Ka1"),
        ("loose_head_damped", 3.0, {"z": 0.1, "f": 2.2, "h": 0.6}, "zeta_loose"),
    ],
)
def test_evidence_for_another_form_is_far_above_that_for_the_declared_one(
    plain_lines: list[Lines], form: str, size: float, constants: dict[str, float], constant: str
) -> None:
    body = shaped(FORMS[form], BASE, BASE.truth, size, constants)
    assert body is not None
    lines = plain_lines[0]
    change = frf(body, body.truth, lines.f) - frf(BASE, BASE.truth, lines.f)
    data = Data.of(replace(lines, y=lines.y + change))
    base = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, drawn_starts(OPEN, 0, 16))
    none = Hypothesis((), base.log_evidence, base)
    name = FORMS[form].mechanism
    declared = single(base, np.array([base.theta]), data, name, [], base.residual(data))
    (other,) = in_other_forms(base, data, none, [declared])
    assert other.log_evidence > declared.log_evidence + 5
    (found,) = [s for s in other.sizes if s.name == constant]
    true = constants.get("r", constants.get("z"))
    assert abs(found.estimate - true) < 3.5 * found.se
    assert found.se < true


def test_the_declared_form_loses_at_most_its_half_of_the_prior(plain_lines: list[Lines]) -> None:
    data = Data.of(plain_lines[0])
    base = Fitter(OPEN, weak_prior(OPEN, OPEN), data.f).best(data, drawn_starts(OPEN, 0, 8))
    one, other = Hypothesis(("head_mode",), -10.0, base), Hypothesis(("head_mode",), -300.0, base)
    assert mixed(one, other).log_evidence == pytest.approx(-10.0 - np.log(2))
    assert mixed(other, one).log_evidence == pytest.approx(-10.0 - np.log(2))
    none = Hypothesis((), -1.0, base)
    assert in_other_forms(base, data, none, [one]) == [one]  # far below no effect: nothing is fitted again
    assert library.effect("head_mode").forms
