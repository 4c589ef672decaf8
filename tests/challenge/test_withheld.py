"""The delta of causes without a closed form: what linear theory gives, and what is left of a threshold in noise."""

from __future__ import annotations

import numpy as np
import pytest
from mcstudy_challenge.bodies.foreign_effects import FOREIGN
from mcstudy_challenge.bodies.foreign_recordings import simulate_foreign
from mcstudy_challenge.bodies.geometry import Geometry, Setting, free
from mcstudy_challenge.bodies.withheld_causes import Simulate, Withheld

from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import InputError
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

BASE = two_segment()
SETTING = Setting.of(Protocol(amplitudes=(5.0,)), 8.0)
GEOMETRY = Geometry(free(BASE), BASE.truth, SETTING, SETTING.protocol.noise)


def foreign(name: str) -> Simulate:
    """What a mechanism of a foreign body does to the nominal body."""

    def simulate(size: float, protocol: Protocol, rng: np.random.Generator) -> Recording:
        shapes = {k: low for k, (low, _) in FOREIGN[name].shapes.items()}
        return simulate_foreign(protocol, BASE.truth, rng, FOREIGN[name] if size else None, size, shapes)

    return simulate


def dead_zone(size: float, protocol: Protocol, rng: np.random.Generator) -> Recording:
    """The threshold of the library."""
    names, sizes = (["dead_zone"], {"dead_angle": size}) if size else ([], {})
    return simulate_recording(protocol, BASE.truth, rng, effects=names, sizes=sizes)


@pytest.mark.parametrize("lag", [1e-4, 1e-2])
def test_the_delta_of_a_camera_is_that_of_linear_theory_even_where_it_is_far_faster_than_a_sample(lag: float) -> None:
    s = 2j * np.pi * SETTING.f[:, None] * lag
    theory = np.linalg.norm(GEOMETRY.unexplained(frf(BASE, BASE.truth, SETTING.f) / (1 + s + s**2 / 2)))
    measured = Withheld(GEOMETRY, foreign("camera"), lasting=True, named=True).measure(lag)
    assert measured.delta == pytest.approx(theory, rel=0.1)


def test_noise_does_not_change_the_mean_response_of_a_linear_cause() -> None:
    silent, noisy = (
        Withheld(GEOMETRY, foreign("slow_bias"), True, True, noisy).measure(20.0) for noisy in (False, True)
    )
    assert np.linalg.norm(GEOMETRY.unexplained(noisy.response)) == pytest.approx(silent.delta, rel=0.1)
    assert noisy.delta == pytest.approx(silent.delta, rel=0.1)
    assert noisy.louder is not None
    assert np.trace(noisy.louder, axis1=1, axis2=2).real / 2 == pytest.approx(1.0, abs=0.2)


def test_a_threshold_far_below_the_noise_is_invisible_although_it_is_not_without_noise() -> None:
    silent, noisy = (Withheld(GEOMETRY, dead_zone, True, True, noisy).measure(1e-5) for noisy in (False, True))
    assert silent.delta > 2
    assert noisy.delta < silent.delta / 3


def test_a_change_over_the_record_is_measured_against_noise_that_contains_its_differences_between_cycles() -> None:
    wander = Withheld(GEOMETRY, foreign("wandering_delay"), lasting=False, named=False)
    slow = wander.measure(0.005)
    assert slow.louder is not None
    wide = np.trace(slow.louder, axis1=1, axis2=2).real / 2
    assert (wide >= 1.0).all()
    assert wide.max() < 10.0
    with pytest.raises(InputError, match="more than 30 times as large"):
        wander.measure(0.05)  # the body oscillates by itself: a delta of several hundred without this
    steady = Withheld(GEOMETRY, foreign("slow_bias"), lasting=False, named=False).measure(20.0)
    assert steady.louder is not None
    assert np.trace(steady.louder, axis1=1, axis2=2).real / 2 == pytest.approx(1.0, abs=0.05)
