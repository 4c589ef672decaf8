"""Do the intervals of the torque that a mechanism leaves hold a known one?

    python pipelines/validation/remaining_torque.py [CASES]

Every recording is of a body with one mechanism of the library (every second one) and a torque with a drawn transfer
function of 0 to 3 poles and 10 to 40 % of the active torque of its joint, simulated in time. The model is fitted with
the mechanism, then the torque is estimated. Two to three CPU seconds per case; 40 cases by default.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcstudy_challenge.bodies.geometry import stands
from mcstudy_challenge.scores.rates import rate

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.fitting.penalised import Fitted, Fitter
from mcstudy.gap.candidates.rational_torque import MOST_POLES, Loop, extended, paths
from mcstudy.gap.candidates.rational_torque import Path as TorquePath
from mcstudy.gap.questions.interval import Interval
from mcstudy.gap.questions.remaining_torque import remaining_torque
from mcstudy.lines.base_fit import base_fit
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.stimulus import Prts

BASE = two_segment()
MECHANISM, SIZE = "passive_damping_ankle", 40.0
PROTOCOL = Protocol(waveform=Prts(rate_hz=100.0), amplitudes=(5.0, 5.0), cycles=6)
AT_HZ = (0.3, 1.0, 3.0)
"""Frequencies at which intervals are judged, besides the clearest line."""


def drawn(seed: int) -> tuple[Model, np.ndarray, np.ndarray, TorquePath, int]:
    """The model with a torque, its parameters, those of the torque, its path and its number of poles; it stands."""
    rng = np.random.default_rng([seed, 41])
    poles = seed % (MOST_POLES + 1)
    with_mechanism = seed % 2 == 0
    f = np.geomspace(0.05, 8.0, 60)
    while True:
        body = BASE.truth * (1 + rng.uniform(-0.15, 0.15, BASE.truth.size))
        model = library.apply(opened(BASE), MECHANISM) if with_mechanism else opened(BASE)
        theta = np.append(body, SIZE) if with_mechanism else body
        held = Fitted(model, weak_prior(model, opened(BASE)), theta, 0.0, 0.0, np.eye(theta.size))
        choices = [p for p in paths(model) if p.sense != "stimulus" and p.gains(poles)]
        path = choices[rng.integers(len(choices))]
        loop = Loop.of(held, f)
        scale = loop.scale(path, model)
        whole, prior = extended(held, path, poles, f, scale)
        n = len(path.gains(poles))
        shape = np.empty(0)
        if poles % 2:
            shape = np.append(shape, 2 * np.pi * np.exp(rng.uniform(np.log(0.4), np.log(4.0))))
        if poles > 1:
            shape = np.append(shape, [2 * np.pi * np.exp(rng.uniform(np.log(0.4), np.log(4.0))), rng.uniform(0.1, 1.0)])
        gains = rng.standard_normal(n) * prior.scale[theta.size : theta.size + n]
        torque = np.abs(path.basis(poles, shape, 2j * np.pi * f) @ gains) * np.abs(path.signal(loop.H, model.angles))
        active = np.abs(loop.torque[:, model.rows.index(path.row)])
        gains *= rng.uniform(0.1, 0.4) * np.sqrt((active**2).sum() / (torque**2).sum())
        added = np.concatenate([gains, shape])
        values = np.concatenate([theta, added])
        if stands(whole, values, 0.2):
            return whole, values, added, path, poles


def case(seed: int) -> dict[str, Any]:
    """One recording: what was true, and whether the intervals hold it, for the path found and for the true one."""
    whole, values, added, path, poles = drawn(seed)
    rng = np.random.default_rng([seed, 42])
    lines = measure(simulate_recording(PROTOCOL, values, rng, model=whole))
    fit = base_fit(lines, BASE, seed)
    data, base, fitted, minima = fit.data, fit.model, fit.best, fit.minima
    if seed % 2 == 0:
        model = library.apply(base, MECHANISM)
        starts = np.array([[*m, x] for m in minima for x in (0.0, SIZE, 2 * SIZE)])
        fitted = Fitter(model, weak_prior(model, base), data.f).best(data, starts)
    true = path.transfer(poles, added, data.f)
    rest = remaining_torque(fitted, data, lines.power, rng)
    given = remaining_torque(fitted, data, lines.power, rng, [path])
    out: dict[str, Any] = {
        "seed": seed,
        "poles": poles,
        "found": rest.found,
        "path": (rest.row, rest.sense) == (path.row, path.sense),
        "path_probability": rest.path_probability,
        "poles_found": given.poles,
        "poles_weight": given.poles_weight.tolist(),
        "fall": fitted.chi2 - given.chi2,
    }
    for hz in (*AT_HZ, given.clearest_hz):
        k = int(np.abs(data.f - hz).argmin())
        gain, phase = given.at(hz)
        turn = phase.estimate + (np.rad2deg(np.angle(true[k])) - phase.estimate + 180) % 360 - 180
        name = "clearest" if hz == given.clearest_hz else f"{hz:g}"
        out[f"gain {name}"] = _holds(gain, abs(true[k]))
        out[f"phase {name}"] = _holds(phase, turn)
        out[f"width {name}"] = float((gain.high - gain.low) / abs(true[k]))
    loop = Loop.of(fitted, data.f)
    rms = np.sqrt(2 * lines.power @ np.abs(true * path.signal(loop.H, whole.angles)) ** 2)
    assert given.rms is not None
    out["rms"] = _holds(given.rms, float(rms))
    return out


def _holds(interval: Interval, value: float) -> bool:
    return bool(interval.low <= value <= interval.high)


def table(cases: list[Mapping[str, Any]]) -> str:
    """Coverage of every interval, and how often path and number of poles are found."""
    shown = [c for c in cases if c["found"]]
    rows = [f"{len(cases)} recordings, in {len(shown)} of them a torque is found"]
    stated = 100 * float(np.mean([c["path_probability"] for c in shown]))
    rows.append(f"true path, among those found: {rate([c['path'] for c in shown]).text()}, stated {stated:.0f} %")
    rows.append(f"true number of poles, path given: {rate([c['poles_found'] == c['poles'] for c in cases]).text()}")
    for key in (
        "rms",
        *(f"{what} {at}" for what in ("gain", "phase") for at in (*(f"{x:g}" for x in AT_HZ), "clearest")),
    ):
        rows.append(f"95 % interval of {key} holds the truth, path given: {rate([c[key] for c in cases]).text()}")
    return "\n".join(rows)


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    kept = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    done: list[Mapping[str, Any]] = []
    for k in range(number):
        done.append(case(k))
        if kept is not None:
            kept.write_text(json.dumps(done), encoding="utf-8")
    print(table(done))
