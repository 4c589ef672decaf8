"""An effect registered from outside the package is treated like the library's own, whatever its kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mcstudy.effect_library import edits as add
from mcstudy.effect_library import library
from mcstudy.effect_library.declarations import active_gain, terms
from mcstudy.effect_library.effect import Effect, Size
from mcstudy.errors import InputError
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnose import diagnose_lines
from mcstudy.gap.questions.contrasts import contrast
from mcstudy.gap.settings import FAST
from mcstudy.lines.base_fit import drawn_starts
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Term
from mcstudy.stance.response import frf

BASE = two_segment()

GAIN = 0.05
"""Change of the active gains, small enough for the responses to follow it linearly."""

LINEAR = Effect(
    name="hip_acceleration_feedback",
    equation="hip torque + Ka2 s^2 e^{-Td2 s} theta2",
    place=("hip",),
    sizes=(
        Size(
            name="Ka2",
            unit="N m s^2/rad",
            null=0.0,
            lower=-4.0,
            upper=4.0,
            published=(0.5, 2.0),
            meaning="acceleration gain of the hip loop",
        ),
    ),
    build=terms(Term("hip", "theta2", ("Ka2",), 2, add.OWN, noisy=True)),
    source="made for this test",
)


def gain_change(name: str, **fields: object) -> Effect:
    """An effect that changes the active gains."""
    size = Size(name=f"size_{name}", unit="", null=0.0, lower=-1.0, upper=1.0, published=(0.1, 0.4), meaning="change")
    rest: dict = {"order": 2, "rule": lambda *_: {}, **fields}
    return Effect(
        name=name,
        equation="active gains change",
        place=("ankle", "hip"),
        sizes=(size,),
        build=active_gain(f"gain_{name}"),
        source="test",
        **rest,
    )


STRONGER = gain_change("stronger_when_larger", kind="nonlinear", contrast="amplitude", gain_sign=1)
WARMING_UP = gain_change(
    "warming_up", kind="nonstationary", contrast="time", gain_sign=1, size_from_gain=lambda gain, _: 3 * gain
)


def test_a_linear_effect_is_found_and_sized(with_effects: Callable[..., Lines]) -> None:
    with library.LIBRARY.extended(LINEAR):
        lines = with_effects(0, {LINEAR.name: {"Ka2": 1.5}})
        d = diagnose_lines(lines, BASE, FAST)
    assert d.detected
    assert LINEAR.name in {e for group in d.causes[0].alternatives for e in group}
    own = next(h for h in d.causes if h.effects == (LINEAR.name,))
    assert own.sizes[0].estimate == pytest.approx(1.5, abs=4 * own.sizes[0].se)
    assert LINEAR.name not in library.LIBRARY


@pytest.mark.parametrize("effect", [STRONGER, WARMING_UP], ids=lambda e: e.name)
def test_a_gain_change_is_found_with_its_sign(plain_lines: list[Lines], effect: Effect) -> None:
    lines = plain_lines[0]
    data, model = Data.of(lines), opened(BASE)
    fitted = Fitter(model, weak_prior(model, model), data.f).best(data, drawn_starts(model, 0, 8))
    halves = lines.halves()
    assert halves is not None
    first, last = halves
    with library.LIBRARY.extended(effect):
        traced = library.trace(fitted.model, effect.name)
        change = frf(traced, np.append(fitted.theta, GAIN), lines.f) - frf(fitted.model, fitted.theta, lines.f)
        moved = replace(last, y=last.y + change)
        out = contrast(str(effect.contrast), first, moved, (3.0, 5.0), fitted, np.random.default_rng(1), 200)
    assert out.p_value == 1 / 201
    own = next(c for c in out.changes if c.effect == effect.name)
    assert own.z > 3
    assert own.gain == pytest.approx(GAIN, abs=4 * own.se)
    assert own.size == (None if effect is STRONGER else 3 * own.gain)


def test_the_sign_of_a_gain_change_must_be_declared() -> None:
    with pytest.raises(InputError, match="'mute': contrast: expected an effect that is not linear, with gain_sign"):
        gain_change("mute", kind="nonlinear", contrast="amplitude")


def test_names_are_unique() -> None:
    with pytest.raises(InputError, match="already has one of this name"), library.LIBRARY.extended(LINEAR, LINEAR):
        pass
    assert LINEAR.name not in library.LIBRARY
    clash = replace(LINEAR, name="other", sizes=(replace(LINEAR.size, name="Bpas1"),))
    with pytest.raises(InputError, match="parameter 'Bpas1' is already that of passive_damping_ankle"):
        library.LIBRARY.register(clash)
