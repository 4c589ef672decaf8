"""Fits of simulated people, one of every kind, shared by the tests of what is said about them."""

from __future__ import annotations

import pytest

import mcstudy as mc

EFFECT = "passive_damping_ankle"


@pytest.fixture(scope="session")
def fits() -> dict[str, mc.FitResult]:
    """By kind: a good recording, a short one, one up to 1.2 Hz, one on tight bounds, one that lacks an effect, and the
    same with it."""
    short, damped = mc.simulate(seed=5, cycles=3), mc.simulate({EFFECT: 100.0}, cycles=6, seed=2)
    return {
        "good": mc.fit(mc.simulate(seed=11, cycles=6), fmax=3.0),
        "short": mc.fit(short, fmax=3.0),
        "low fmax": mc.fit(short, fmax=1.2),
        "on bounds": mc.fit(short, fmax=2.0, bounds={"K12": (0, 200), "Td2": (0.15, 0.2), "B22": (0, 20)}),
        "effect missing": mc.fit(damped, fmax=3.0),
        "effect added": mc.fit(damped, fmax=3.0, effects=[EFFECT]),
    }
