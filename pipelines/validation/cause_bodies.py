"""People of the foreign simulator with hidden causes, for checks of what is said about their parameters.

As in the challenge `gap_challenge_foreign.toml`: nothing of the models, effects and simulators that are judged makes
these recordings. Here a body may also have two mechanisms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mcstudy_challenge.bodies.draws import draw_body, protocol_of
from mcstudy_challenge.bodies.foreign_effects import FOREIGN, ForeignEffect, recorded
from mcstudy_challenge.bodies.foreign_recordings import draw_foreign, foreign_pool, simulate_foreign
from mcstudy_challenge.bodies.withheld_causes import Drawn
from mcstudy_challenge.challenge_file import read_challenge
from mcstudy_challenge.design import MAIN, Series

from mcstudy.effect_library.protocol import Protocol
from mcstudy.errors import InputError
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.streams import stream

CLASSES = {"none": 0.2, "one known": 0.4, "pair": 0.2, "outside": 0.2}
"""Kinds of bodies: what is missing, and their shares."""

REDRAWS = 40
"""Causes that are drawn for one body before it is given up."""


@dataclass(frozen=True)
class Person:
    """One body of a kind of `CLASSES` with the true values of the model's parameters.

    Attributes
    ----------
    name, kind, causes: what it is called, its kind, names in `FOREIGN`. delta: how detectable each cause is.
    truth: parameters by name. recording: of the protocol.
    """

    name: str
    kind: str
    causes: tuple[str, ...]
    delta: tuple[float, ...]
    truth: dict[str, float]
    recording: Recording

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """Names of the library's effects that the causes are forms of; empty for one outside."""
        return tuple(FOREIGN[c].mechanism for c in self.causes)


def person(seed: int, number: int, kind: str, cycles: int | None = None) -> Person | None:
    """One body; None if none of the kind is stable in `REDRAWS` draws. ``cycles``: of its recording, else as usual."""
    rng, series = stream(seed, "cause bodies", number), read_challenge("gap_challenge_foreign").series[MAIN]
    protocol = protocol_of(series)
    for _ in range(REDRAWS):
        made = _drawn(kind, series, rng)
        if made is None:
            continue
        theta, causes, delta, simulate = made
        try:
            recording = simulate(replace(protocol, cycles=cycles or protocol.cycles), rng)
        except InputError:
            continue
        truth = dict(zip(two_segment().names, map(float, theta), strict=True))
        name = f"{kind.replace(' ', '_')}_{seed}_{number}"
        return Person(name, kind, causes, delta, truth, replace(recording, name=name))
    return None


def _drawn(kind: str, series: Series, rng: np.random.Generator) -> tuple[Any, ...] | None:
    if kind == "none":
        theta = draw_body(series, rng, False)

        def nothing(protocol: Protocol, own: np.random.Generator) -> Recording:
            return simulate_foreign(protocol, theta, own)

        return theta, (), (), nothing
    pool = foreign_pool(series, kind == "outside")
    first = pool[int(rng.integers(len(pool)))]
    drawn = draw_foreign(series, rng, first)
    if drawn is None:
        return None
    if kind != "pair":
        return drawn.theta, (first.name,), (drawn.measured.delta,), drawn.simulate
    second = pool[int(rng.integers(len(pool)))]
    return None if second.mechanism == first.mechanism else _both(series, rng, first, drawn, second)


def _both(
    series: Series, rng: np.random.Generator, first: ForeignEffect, drawn: Drawn, second: ForeignEffect
) -> tuple[Any, ...] | None:
    """Both mechanisms in one body: that of the first, the size of the second as on a body of its own."""
    other = draw_foreign(series, rng, second)
    if other is None:
        return None
    one, two = sorted(((first, drawn), (second, other)), key=lambda e: e[0].change is None)  # a camera comes last
    if one[0].change is None:
        return None
    sizes = one[1].sizes, two[1].sizes

    def change(p: Any, size: float, _: Any) -> Any:
        own = one[0].change(p, sizes[0]["size"], sizes[0])  # type: ignore[misc]
        return own if two[0].change is None else two[0].change(own, size, sizes[1])

    def simulate(protocol: Protocol, own: np.random.Generator) -> Recording:
        if two[0].change is None:
            angles = replace(two[0], change=change)
            plain = simulate_foreign(protocol, drawn.theta, own, angles, sizes[1]["size"], {})
            return filmed(plain, sizes[1]["size"])
        return simulate_foreign(protocol, drawn.theta, own, replace(two[0], change=change), sizes[1]["size"], {})

    delta = tuple(d.measured.delta for _, d in (one, two))
    return drawn.theta, (one[0].name, two[0].name), delta, simulate


def filmed(recording: Recording, lag_s: float) -> Recording:
    """The recording behind the filter of a camera."""
    trials = tuple(replace(t, theta=recorded(t.theta, recording.rate_hz, lag_s)) for t in recording.trials)
    return replace(recording, trials=trials)
