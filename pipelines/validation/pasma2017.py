"""The statements of Pasma et al. 2017 about their model, side by side with ours.

    python pipelines/validation/pasma2017.py

Front Comput Neurosci 11:99, doi 10.3389/fncom.2017.00099: a sensitivity analysis of the independent-channel model at
the parameters of its Table 1. Printed for every parameter: by how many percent the magnitude, and by how many degrees
the phase, of the response to a tilt changes when the parameter grows by 10 %, in four bands. Then each statement of the
abstract, in our words, with the two numbers that decide it. Whether passive torque acts relative to the surface could
not be read: both readings are computed. Derivatives are exact (`mcstudy.stance.response.frf_jacobian`).
"""

from __future__ import annotations

import argparse

import numpy as np

from mcstudy.models.catalogue import read_model
from mcstudy.stance.response import frf_jacobian
from pipelines import measured

BANDS = {"0.05–0.1 Hz": (0.05, 0.1), "0.1–0.5 Hz": (0.1, 0.5), "0.5–0.9 Hz": (0.5, 0.9), "0.9–2.5 Hz": (0.9, 2.5)}
READINGS = {"surface": "independent_channel", "space": "independent_channel_visual"}
F = np.arange(0.05, 2.501, 0.01)
"""Hz."""


def effects(name: str) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, and what 10 % more of each parameter does: percent of the magnitude (N, P), degrees of phase (N, P)."""
    model = read_model(name).model()
    H, slope = frf_jacobian(model, model.truth, F)
    change = 0.1 * slope[:, 0] * model.truth / H[:, :1]
    names = tuple("W" if n in ("Wp", "Wv") else n for n in model.names)
    return names, 100 * change.real, np.degrees(change.imag)


def mean(change: np.ndarray, low: float, high: float) -> np.ndarray:
    """Root mean square over a band, (P,)."""
    return np.asarray(np.sqrt((change[(low - 1e-9 <= F) & (high + 1e-9 >= F)] ** 2).mean(axis=0)))


def statements(names: tuple[str, ...], magnitude: np.ndarray, phase: np.ndarray) -> list[list[str]]:
    """Each statement, the two numbers that decide it, and whether it holds: the first must be the larger one."""
    at = {n: k for k, n in enumerate(names)}

    def inside(change: np.ndarray, name: str, low: float, high: float) -> tuple[float, float]:
        within = (low - 1e-9 <= F) & (high + 1e-9 >= F)
        each = change[:, at[name]]
        return float(np.sqrt((each[within] ** 2).mean())), float(np.sqrt((each[~within] ** 2).mean()))

    def largest(group: tuple[str, ...], change: np.ndarray) -> float:
        return max(float(np.sqrt((change[:, at[n]] ** 2).mean())) for n in group)

    strong, weak = ("Kp", "Kd", "tau", "W"), ("K", "Kf", "Tf")
    least = min(largest((n,), magnitude) + largest((n,), phase) for n in strong)
    most = max(largest((n,), magnitude) + largest((n,), phase) for n in weak)
    weight = magnitude[:, at["W"]]
    cases = [
        ("Kp shapes the magnitude at 0.1–1 Hz (% there, % elsewhere)", *inside(magnitude, "Kp", 0.1, 1.0)),
        ("Kd shapes the magnitude at 0.5–0.9 Hz (% there, % elsewhere)", *inside(magnitude, "Kd", 0.5, 0.9)),
        ("delay shapes the phase above 0.6 Hz (deg there, deg below)", *inside(phase, "tau", 0.6, 2.5)),
        (
            "weight changes the whole magnitude (least %, a tenth of its largest)",
            float(weight.min()),
            float(weight.max() / 10),
        ),
        ("weight changes no phase (1 deg, largest change)", 1.0, float(np.abs(phase[:, at["W"]]).max())),
        ("force feedback and K matter little (least of Kp, Kd, delay, W; most of Kf, Tf, K)", least, most),
    ]
    return [[what, f"{a:.2f}", f"{b:.2f}", "yes" if a > b else "no"] for what, a, b in cases]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    measured.add_option(parser)
    args = parser.parse_args()
    tables, held = {}, {}
    for reading, name in READINGS.items():
        names, magnitude, phase = effects(name)
        header = ("10 % more of", *(f"{b}: %, deg" for b in BANDS))
        rows = [
            [n, *(f"{mean(magnitude, *b)[k]:.2f}, {mean(phase, *b)[k]:.2f}" for b in BANDS.values())]
            for k, n in enumerate(names)
        ]
        said = statements(names, magnitude, phase)
        held[reading] = {"value": sum(row[-1] == "yes" for row in said)}
        tables |= {reading: (header, rows), f"{reading}_statements": (("statement", "first", "second", "holds"), said)}
        print(reading, *("  ".join(row) for row in [list(header), *rows, *said]), sep="\n  ")
    measured.write(args.json, held, tables)


if __name__ == "__main__":
    main()
