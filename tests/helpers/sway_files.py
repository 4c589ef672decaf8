"""Files of sway as laboratories write them, from a simulated person whose angles are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mcstudy.effect_library.simulation import simulate
from mcstudy.models.catalogue import read_model
from mcstudy.recordings.sheets.body_sheet import BodySheet, body_of
from mcstudy.stance.stimulus import Prts

HEIGHT, WEIGHT = 1.71, 65.5

PERSON = {"height": HEIGHT, "weight": WEIGHT}

RATE, STATE_S, CYCLES = 100.0, 0.25, 5

PERIOD = 80 * STATE_S


def person_constants() -> dict[str, float]:
    """J, mgh, m and h of the person."""
    return body_of(BodySheet(**PERSON), _no_file, "body").constants


def _no_file(name: str) -> None:
    raise AssertionError(name)


@dataclass(frozen=True)
class Sway:
    """One trial: times (s), tilt and sway (rad), each (n,)."""

    time: np.ndarray
    tilt: np.ndarray
    sway: np.ndarray


def simulated(model: str = "independent_channel", degrees: float = 2.0, cycles: int = CYCLES, seed: int = 0) -> Sway:
    """Sway of the person under a ternary sequence of 80 states, ``degrees`` from peak to peak, with sensor noise."""
    constants = {n: x for n, x in person_constants().items() if n in ("J", "mgh")}
    recording = simulate(
        model=read_model(model).with_constants(constants).model(),
        waveform=Prts(stages=4, rate_hz=RATE, state_s=STATE_S, convention="peak_to_peak"),
        amplitude=np.deg2rad(degrees),
        cycles=cycles,
        noise=0.3,
        seed=seed,
    )
    (trial,) = recording.trials
    return Sway(np.arange(trial.samples) / RATE, trial.stimulus, trial.theta[:, 0])


def write_table(path: Path, columns: dict[str, np.ndarray], delimiter: str = ",", decimal: str = ".") -> Path:
    """A table with a line of names; nan is an empty cell."""
    table = np.column_stack(list(columns.values()))
    lines = [delimiter.join(columns)]
    for row in table.tolist():
        cells = ("" if np.isnan(x) else f"{x:.10g}".replace(".", decimal) for x in row)
        lines.append(delimiter.join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
