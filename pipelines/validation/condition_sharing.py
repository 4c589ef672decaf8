"""Does sharing pay, and are intervals and tests of several conditions right?

    python pipelines/validation/condition_sharing.py --people 200 --json pipelines/measured/condition_sharing.json

People in the sensorimotor integration test: the surface tilts by 0.5, 2 and 8 degrees peak to peak (80 states of
0.25 s, 11 cycles of 20 s of which the first is left out), the weight of proprioception is 0.7, 0.534 and 0.35, and all
else is equal. Remnant of 0.25, 0.5 and 1.2 degrees RMS (an assumption), whose spectrum is that of sensor noise through
the loop, and 0.02 degrees RMS of white measurement noise. Printed are the coefficients of variation of one amplitude
alone and of all three together, from the information matrix and of simulated people; how often 95 % intervals hold the
truth; and how often the test of each sharing, which holds for all but the weight, rejects at the 5 % level.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import binomtest, kstest

import mcstudy as mc
from mcstudy.fitting.penalised import whiten
from mcstudy.identification.fit import searched
from mcstudy.identification.settings import FitSettings
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.columns import model_of
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import joined, split
from mcstudy.stance.noise import SensorNoise, record_frequencies, white_coefficients
from mcstudy.stance.response import frf, frf_jacobian, noise_response
from mcstudy.streams import stream
from pipelines.measured import add_option, write

RATE_HZ, PERIOD_S, CYCLES, FMAX = 100.0, 20.0, 11, 2.5
TILTS = {"0.5": 0.7, "2": 0.534, "8": 0.35}
"""Tilts, degrees peak to peak, and the weight of proprioception in each."""

REMNANT_DEG, WHITE_DEG = {"0.5": 0.25, "2": 0.5, "8": 1.2}, 0.02
SHARED = ("Kp", "Kd", "tau", "Kt")
BANDWIDTH = np.geomspace(1e-4, RATE_HZ / 2, 20000)


def velocity() -> np.ndarray:
    """The pseudorandom ternary sequence of the published test, (80,): x[n] = 2 x[n-3] + x[n-4] modulo 3."""
    x = [1, 1, 1, 1]
    while len(x) < 80:
        x.append((2 * x[-3] + x[-4]) % 3)
    return np.where(np.array(x) == 2, -1, np.array(x)).astype(float)


@dataclass(frozen=True)
class Condition:
    """One tilt: its model, and one period of the stimulus in rad."""

    name: str
    model: Model
    tilt: np.ndarray

    @classmethod
    def of(cls, name: str, weight: float) -> Condition:
        """With a tilt of that many degrees."""
        model = model_of("sensorimotor_integration")
        assert model is not None
        tilt = np.cumsum(np.repeat(velocity(), round(0.25 * RATE_HZ)))
        tilt = (tilt - tilt.mean()) * np.radians(float(name)) / np.ptp(tilt)
        return cls(name, model.with_values({"Wp": weight}), tilt)

    def psd(self, f: np.ndarray) -> np.ndarray:
        """Of the noise of the sway, rad^2/Hz, (N,)."""

        def shape(f: np.ndarray) -> np.ndarray:
            sensed = SensorNoise((1.0, 0.0)).psd(f)
            return np.einsum("nys,ns->n", np.abs(noise_response(self.model, self.model.truth, f)) ** 2, sensed)

        level = np.radians(REMNANT_DEG[self.name]) ** 2 / np.trapezoid(shape(BANDWIDTH), BANDWIDTH)
        return level * shape(f) + np.radians(WHITE_DEG) ** 2 / (RATE_HZ / 2)

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Odd lines, Hz, and the coefficients of the stimulus there."""
        odd = np.arange(1, round(FMAX * PERIOD_S), 2)
        return odd / PERIOD_S, (np.fft.rfft(self.tilt) / self.tilt.size)[odd]

    def recording(self, rng: np.random.Generator) -> mc.Recording:
        """A simulated record: the periodic response, and noise with the spectrum of `psd`."""
        n, whole = self.tilt.size, self.tilt.size * CYCLES
        own, every = record_frequencies(n, RATE_HZ)[1:], record_frequencies(whole, RATE_HZ)[1:]
        drive = np.fft.rfft(self.tilt)
        drive[1:] *= frf(self.model, self.model.truth, own)[:, 0]
        scale = np.concatenate([[0.0], np.sqrt(self.psd(every) * RATE_HZ / whole / 2)]) * whole
        noise = np.fft.irfft(scale * white_coefficients(rng, whole, 1)[:, 0], whole)
        sway = np.tile(np.fft.irfft(drive, n), CYCLES) + noise
        trial = mc.Trial(np.tile(self.tilt, CYCLES), sway[:, None])
        return mc.Recording((trial,), RATE_HZ, PERIOD_S, name=f"{self.name} deg", condition=self.name, model=self.model)


def predicted(conditions: list[Condition]) -> dict[str, float]:
    """Coefficients of variation in percent from the information matrix, with a weight for each condition."""
    known = [c.lines() for c in conditions]
    joint = joined(
        [replace(c.model, parameters=conditions[0].model.parameters) for c in conditions], [f.size for f, _ in known]
    )
    joint = replace(joint, blocks=tuple(replace(b, name=c.name) for b, c in zip(joint.blocks, conditions, strict=True)))
    model = split(joint, ["Wp"]) if len(conditions) > 1 else conditions[0].model
    weights = [c.model.truth[-1] for c in conditions]
    theta = np.array([*model.truth[:4], *weights])
    f = np.concatenate([f for f, _ in known])
    variance = np.concatenate(
        [c.psd(f) / (2 * PERIOD_S * (CYCLES - 1) * np.abs(u) ** 2) for c, (f, u) in zip(conditions, known, strict=True)]
    )
    root = np.sqrt(2 / variance)[:, None, None].astype(complex)
    jacobian = whiten(root, frf_jacobian(model, theta, f)[1])
    sd = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return dict(zip(model.names, 100 * sd / theta, strict=True))


@dataclass
class Person:
    """What the fits of one person gave."""

    joint: dict[str, float]
    alone: dict[str, float]
    held: dict[str, bool]
    p: dict[str, float]


def fitted(seed: int, conditions: list[Condition], truth: dict[str, float]) -> Person:
    """One simulated person, in all conditions and in the middle one alone."""
    rng = stream(seed, "condition sharing")
    recordings = [c.recording(rng) for c in conditions]
    fit = mc.fit_conditions(recordings, fmax=FMAX, seed=seed)
    checked = checked_recording(recordings[1], LineSettings(fmax=FMAX))
    alone = searched(checked.lines, checked.nominal, FitSettings(seed=seed), "alone")
    return Person(
        joint={name: fit[name].estimate for name in truth},
        alone=dict(zip(alone.model.names, alone.theta.tolist(), strict=True)),
        held={name: fit[name].low <= value <= fit[name].high for name, value in truth.items()},
        p={name: fit.sharing(name).p_value for name in SHARED},
    )


def main(argv: list[str] | None = None) -> None:
    """Print the tables, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=200)
    add_option(parser)
    args = parser.parse_args(argv)
    conditions = [Condition.of(name, weight) for name, weight in TILTS.items()]
    middle = conditions[1].model
    shared = dict(zip(middle.names[:4], middle.truth.tolist(), strict=False))
    truth = shared | {f"Wp_{name.replace('.', '_')}": weight for name, weight in TILTS.items()}
    one, three = predicted(conditions[1:2]), predicted(conditions)
    people = [fitted(k, conditions, truth) for k in range(args.people)]
    rows, tests = [], []
    for name, value in truth.items():
        joint = np.array([p.joint[name] for p in people])
        single = np.array([p.alone[name] for p in people]) if name in SHARED else np.full(len(people), np.nan)
        held = sum(p.held[name] for p in people)
        low, high = binomtest(held, len(people)).proportion_ci()
        cv = [100 * np.std(x, ddof=1) / value for x in (single, joint)]
        known = [f"{one[name]:.2f}", f"{cv[0]:.2f}"] if name in SHARED else ["", ""]
        rows.append(
            [
                name,
                *known,
                f"{three[name]:.2f}",
                f"{cv[1]:.2f}",
                f"{100 * held / len(people):.1f} [{100 * low:.0f}, {100 * high:.0f}]",
            ]
        )
    for name in SHARED:
        p = np.array([x.p[name] for x in people])
        low, high = binomtest(int((p < 0.05).sum()), p.size).proportion_ci()
        tests.append(
            [
                name,
                f"{100 * (p < 0.05).mean():.1f} [{100 * low:.0f}, {100 * high:.0f}]",
                f"{kstest(p, 'uniform').pvalue:.2f}",
            ]
        )
    header = [
        "parameter",
        "2° alone, theory",
        "2° alone",
        "three tilts, theory",
        "three tilts",
        "95 % intervals that hold the truth, %",
    ]
    below = ["sharing of", "rejected at 5 %, %", "p uniform (Kolmogorov-Smirnov)"]
    for head, table in ((header, rows), (below, tests)):
        print(*(" | ".join(row) for row in (head, *table)), sep="\n")
    values = {
        "people": {"value": args.people},
        "tau_one": {"value": one["tau"], "unit": "%"},
        "tau_three": {"value": three["tau"], "unit": "%"},
    }
    write(args.json, values, {"cv": (header, rows), "tests": (below, tests)})


if __name__ == "__main__":
    main()
