"""Is the cause named that a declared model lacks, and is nothing named where nothing is missing?

    python pipelines/validation/declared_causes.py --nulls 40 --json pipelines/measured/declared_causes.json

An elbow, a two-mass drive and the independent-channel model of stance (one angle) are simulated by delay differential
equations that are written out here and integrated by a Runge-Kutta method of fourth order with a history: nothing of
them is mcstudy's. Parameters are drawn within 10 % of the declared ones; a noise torque acts in the loop and white
noise on what is recorded. ``--nulls`` recordings of each model lack nothing. Each effect that mcstudy generates for the
model acts in ``--each`` recordings, with the size at which a test that knows the effect would expect z = `EXPECTED` (or
the largest that is stable and within half of the bounds; effects that then give less than z = 4 are not asked for).
Every recording is diagnosed without knowledge of its cause. A cause is right if it is in the set of effects that the
diagnosis reports as indistinguishable, since no test could name it alone.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from scipy.stats import beta

import mcstudy as mc
from mcstudy.effect_library.library import library_of
from mcstudy.effect_library.protocol import body_with_effects
from mcstudy.errors import FallsError
from mcstudy.gap.candidates.signatures import signatures
from mcstudy.gap.diagnose import detect, diagnose
from mcstudy.gap.questions.detection import LEVEL
from mcstudy.gap.settings import CAUSE_ONLY, DiagnosisSettings
from mcstudy.lines.base_fit import base_fit
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.columns import model_of
from mcstudy.stance.feedback import Model
from mcstudy.text_tables import table
from pipelines import measured

EXPECTED = 9.0
"""z of the effects."""

LEAST = 4.0
"""z below which an effect is not asked for."""

SPREAD = 0.10
"""Parameters are within this share of the declared ones."""

HIDDEN_DAMPING = 0.2

Values = Mapping[str, np.ndarray]
"""Parameters and sizes of B recordings by name, (B,) each; an effect that does not act has size 0."""


@dataclass(frozen=True)
class Experiment:
    """How a model is recorded: a multisine of odd lines with this ``peak`` and ``period`` (s), up to ``fmax``.

    ``step``: of the integration, s. ``torque``: density of the noise torque in the loop. ``sd``: of what is recorded.
    """

    model: str
    equations: Callable[[Values, Past, Drive], Callable[..., np.ndarray]]
    states: int
    angles: Mapping[str, int]
    peak: float
    period: float
    fmax: float
    rate: float
    step: float
    torque: float
    sd: float
    cycles: int = 4


class Drive:
    """The stimulus (B,) and its derivatives at half steps, as effects on it leave it, also after a delay (B,)."""

    def __init__(self, e: Experiment, v: Values, rng: np.random.Generator) -> None:
        k = np.arange(1, int(e.fmax * e.period) + 1, 2)
        phase = rng.uniform(0, 2 * np.pi, k.size)
        self.n = round(2 * e.period / e.step)
        self.k, self.s = k, 2j * np.pi * k / e.period
        c = 0.5 * np.exp(1j * phase) / (1 + (k / e.period / (0.3 * e.fmax)))  # more power at low frequencies
        peak = np.abs(self._in_time(c[None])).max()
        self.recorded = c * e.peak / peak
        gain = (1 + v["stimulus_gain"])[:, None] * np.exp(-self.s * v["stimulus_delay"][:, None])
        self.c = self.recorded * gain / (1 + self.s * v["stimulus_lag"][:, None])

    def _in_time(self, c: np.ndarray) -> np.ndarray:
        whole = np.zeros((len(c), self.n // 2 + 1), dtype=complex)
        whole[:, self.k] = c
        return np.fft.irfft(whole, self.n, axis=1, norm="forward").T.copy()

    def at(self, order: int = 0, late: np.ndarray | float = 0.0) -> np.ndarray:
        """(half steps of a period, B)."""
        return self._in_time(self.c * self.s**order * np.exp(-self.s * np.reshape(late, (-1, 1))))


class Past:
    """The last states and their derivatives, (length, B, n), interpolated by Hermite's cubic."""

    def __init__(self, length: int, B: int, states: int, step: float) -> None:
        self.x, self.d = np.zeros((length, B, states)), np.zeros((length, B, states))
        self.step, self.now, self.rows = step, 0, np.arange(B)

    def store(self, x: np.ndarray, d: np.ndarray) -> None:
        """The state at the end of a step."""
        self.x[self.now % len(self.x)], self.d[self.now % len(self.x)] = x, d
        self.now += 1

    def __call__(self, late: np.ndarray, stage: float) -> tuple[np.ndarray, np.ndarray]:
        """States and derivatives (B, n) before a delay (B,), ``stage`` of a step after the last stored one."""
        at = self.now - 1 + stage - late / self.step
        k = np.minimum(np.floor(at).astype(int), self.now - 2)
        f = (at - k)[:, None]
        i, j = k % len(self.x), (k + 1) % len(self.x)
        x0, x1, d0, d1 = self.x[i, self.rows], self.x[j, self.rows], self.d[i, self.rows], self.d[j, self.rows]
        x = (1 + 2 * f) * (1 - f) ** 2 * x0 + f * f * (3 - 2 * f) * x1
        x += self.step * (f * (1 - f) ** 2 * d0 + f * f * (f - 1) * d1)
        return x, (1 - f) * d0 + f * d1


def lagged(state: np.ndarray, signal: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A signal behind a lag, and the derivative of its state; the signal itself where the lag is 0."""
    rate = (signal - state) / np.where(tau > 0, tau, 1.0)
    return np.where(tau > 0, state, signal), np.where(tau > 0, rate, 0.0)


def hidden(x: np.ndarray, z: int, angle: np.ndarray, speed: np.ndarray, hz: np.ndarray) -> np.ndarray:
    """Acceleration of a hidden mass on a spring and damper, whose position and speed are states z and z + 1."""
    w = 2 * np.pi * np.where(hz > 0, hz, 1.0)
    return np.asarray(w**2 * (angle - x[:, z]) + 2 * HIDDEN_DAMPING * w * (speed - x[:, z + 1]))


def elbow(v: Values, past: Past, drive: Drive) -> Callable[..., np.ndarray]:
    """States: angle, speed, lag of the feedback, integral, hidden mass (2)."""
    u, J = drive.at(), 0.08 + v["inertia_elbow"]

    def slope(x: np.ndarray, half: int, stage: float, noise: np.ndarray) -> np.ndarray:
        then, rate = past(v["Td"], stage)
        sensed = v["Kr"] * then[:, 0] + v["Br"] * then[:, 1]
        sensed = sensed + v["integral_elbow"] * then[:, 3] + v["acceleration_elbow"] * rate[:, 1]
        torque, lag = lagged(x[:, 2], sensed, v["feedback_lag_elbow"])
        mass = hidden(x, 4, x[:, 0], x[:, 1], v["hidden_hz_elbow"])
        load = u[half % len(u)] + noise[:, 0] - v["K"] * x[:, 0] - v["B"] * x[:, 1] - torque
        load -= v["hidden_mass_elbow"] * mass
        return np.stack([x[:, 1], load / J, lag, x[:, 0], x[:, 5], mass], axis=1)

    return slope


def two_mass_drive(v: Values, past: Past, drive: Drive) -> Callable[..., np.ndarray]:
    """States: angles and speeds of motor and load, four lags, integral of the load, hidden masses (4)."""
    u, Jm, Jl = drive.at(), 0.02 + v["inertia_motor"], v["Jl"]
    late_load, late_motor = v["Td"] + v["sense_delay_load"], v["Td"] + v["sense_delay_motor"]
    brake_late = v["feedback_delay_load"] + v["sense_delay_load"]

    def slope(x: np.ndarray, half: int, stage: float, noise: np.ndarray) -> np.ndarray:
        m, dm, load, dl = x[:, :4].T
        load_then, load_rate = past(late_load, stage)
        motor_then, _ = past(late_motor, stage)
        P, p_lag = lagged(x[:, 4], 12.0 * load_then[:, 2], v["sense_lag_load"])
        D, d_lag = lagged(x[:, 5], 0.35 * motor_then[:, 1], v["sense_lag_motor"])
        sensed = P * (1 + v["sense_gain_load"]) + D * (1 + v["sense_gain_motor"])
        sensed = sensed + v["integral_motor"] * load_then[:, 8] + v["acceleration_motor"] * load_rate[:, 3]
        torque, t_lag = lagged(x[:, 6], sensed * (1 + v["feedback_gain_motor"]), v["feedback_lag_motor"])
        speed = np.where(brake_late > 0, past(np.maximum(brake_late, past.step), stage)[0][:, 3], dl)
        tau = v["feedback_lag_load"] + v["sense_lag_load"]  # one effect at a time
        brake, b_lag = lagged(x[:, 7], v["bl"] * speed, tau)
        brake = brake * (1 + v["sense_gain_load"])
        shaft = v["Ks"] * (m - load) + v["Bs"] * (dm - dl)
        am, al = (
            hidden(x, 9, m, dm, v["hidden_hz_motor"]),
            hidden(x, 11, load, dl, v["hidden_hz_load"]),
        )
        on_motor = u[half % len(u)] + noise[:, 0] - v["bm"] * dm - shaft - torque - v["stiffness_motor"] * m
        on_load = noise[:, 1] + shaft - brake - v["stiffness_load"] * load
        accelerations = (
            (on_motor - v["hidden_mass_motor"] * am) / Jm,
            (on_load - v["hidden_mass_load"] * al) / Jl,
        )
        return np.stack(
            [dm, accelerations[0], dl, accelerations[1], p_lag, d_lag, t_lag, b_lag, load, x[:, 10], am, x[:, 12], al],
            axis=1,
        )

    return slope


def independent_channel(v: Values, past: Past, drive: Drive) -> Callable[..., np.ndarray]:
    """States: sway, speed, torque, its rate, memory, lags of sway, torque and feedback, integral, hidden mass (2)."""
    J, mgh, tau = 66.0 + v["inertia_body"], 75 * 9.81 * 0.83, v["tau"]
    tilt, rate = drive.at(), drive.at(1)
    seen = [drive.at(order, tau) for order in range(3)]
    late_sway, late_torque = tau + v["sense_delay_sway"], tau + v["sense_delay_torque"]

    def slope(x: np.ndarray, half: int, stage: float, noise: np.ndarray) -> np.ndarray:
        sway, speed, torque, torque_rate, memory = x[:, :5].T
        lag_sway = lagged(x[:, 5], sway, v["sense_lag_sway"])[1]
        lag_torque = lagged(x[:, 6], memory, v["sense_lag_torque"])[1]
        (s, ds), (t, dt) = past(late_sway, stage), past(late_torque, stage)
        was = np.where(v["sense_lag_sway"] > 0, s[:, 5], s[:, 0])
        was_rate = np.where(v["sense_lag_sway"] > 0, ds[:, 5], s[:, 1])
        held = np.where(v["sense_lag_torque"] > 0, t[:, 6], t[:, 4])
        held_rate = np.where(v["sense_lag_torque"] > 0, dt[:, 6], dt[:, 4])
        W, h = v["Wp"], half % len(tilt)
        error = W * seen[0][h] - was + v["Kf"] * held
        error_rate = W * seen[1][h] - was_rate + v["Kf"] * held_rate
        own, own_rate = past(tau, stage)
        curve = W * seen[2][h] - own_rate[:, 1] + v["Kf"] * (own_rate[:, 2] - own_rate[:, 4]) / v["Tf"]
        command = v["Kp"] * error + v["Kd"] * error_rate + v["integral_muscle"] * own[:, 8]
        command = command + v["acceleration_muscle"] * curve
        command, lag = lagged(x[:, 7], command, v["feedback_lag_muscle"])
        w, damping = v["w0"], v["beta"]
        torque_curve = w**2 * (command - torque) - 2 * damping * w * torque_rate
        mass = hidden(x, 9, sway, speed, v["hidden_hz_body"])
        load = mgh * sway + torque + v["K"] * (tilt[h] - sway) + v["B"] * (rate[h] - speed) + noise[:, 0]
        load = load - v["damping_body"] * speed - v["stiffness_body"] * sway - v["hidden_mass_body"] * mass
        error_now = W * tilt[h] - sway + v["Kf"] * memory
        slopes = (speed, load / J, torque_rate, torque_curve, (torque - memory) / v["Tf"], lag_sway, lag_torque, lag)
        return np.stack([*slopes, error_now, x[:, 10], mass], axis=1)

    return slope


EXPERIMENTS = (
    Experiment("elbow", elbow, 6, {"elbow": 0}, 1.0, 10.0, 12.0, 200.0, 2.5e-3, 0.004, 2e-4),
    Experiment("independent_channel", independent_channel, 11, {"sway": 0}, 0.03, 20.0, 4.0, 50.0, 5e-3, 0.4, 2e-4),
    Experiment("two_mass_drive", two_mass_drive, 13, {"motor": 0, "load": 2}, 1.0, 6.0, 25.0, 200.0, 1e-3, 2e-3, 5e-5),
)


def recorded(e: Experiment, model: Model, values: Sequence[Mapping[str, float]], seed: int) -> list[mc.Recording]:
    """A recording of every set of parameters and sizes."""
    rng, B = np.random.default_rng(seed), len(values)
    known = {*model.names, *library_of(model).sizes}
    v = {name: np.array([x.get(name, 0.0) for x in values]) for name in known}
    drive = Drive(e, v, rng)
    past = Past(round(0.6 / e.step) + 4, B, e.states, e.step)
    slope = e.equations(v, past, drive)
    steps, stride, h = round(e.cycles * e.period / e.step), round(1 / (e.rate * e.step)), e.step
    x, out = np.zeros((B, e.states)), np.empty((steps, B, len(e.angles)))
    past.now = 2  # at rest before the first sample
    for n in range(steps):
        out[n] = x[:, list(e.angles.values())]
        noise = e.torque * rng.standard_normal((B, 2)) / np.sqrt(h)
        a = slope(x, 2 * n, 1.0, noise)
        past.store(x, a)
        b = slope(x + h / 2 * a, 2 * n + 1, 0.5, noise)
        c = slope(x + h / 2 * b, 2 * n + 1, 0.5, noise)
        d = slope(x + h * c, 2 * n + 2, 1.0, noise)
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    stimulus = np.tile(drive._in_time(drive.recorded[None])[:: 2 * stride, 0], e.cycles)
    made = []
    for k in range(B):
        angles = [_sensed(out[:, k, i], v, name, k, h)[::stride] for i, name in enumerate(e.angles)]
        theta = np.stack(angles, axis=1) + e.sd * rng.standard_normal((len(stimulus), len(angles)))
        trial = mc.Trial(stimulus, theta, e.peak)
        made.append(mc.Recording((trial,), e.rate, e.period, name=f"{e.model} {seed}.{k}", model=model))
    return made


def _sensed(x: np.ndarray, v: Values, angle: str, k: int, step: float) -> np.ndarray:
    """What a sensor with a lag (bilinear transform at the fine step) and a gain makes of an angle."""
    lag, gain = (float(v.get(f"sensor_{what}_{angle}", np.zeros(k + 1))[k]) for what in ("lag", "gain"))
    a = 2 * lag / step
    return np.asarray((1 + gain) * lfilter([1.0, 1.0], [1 + a, 1 - a], x))


def sizes_to_ask(e: Experiment, model: Model, sound: mc.Recording) -> dict[str, dict[str, float]]:
    """Sizes of the effects that a recording of this kind shows with z = `EXPECTED`, from one that lacks nothing."""
    checked = checked_recording(sound, LineSettings(fmax=e.fmax))
    fit, known = base_fit(checked.lines, checked.nominal, 0), library_of(model)
    linear = [x for x in known.values() if x.kind == "linear"]
    out: dict[str, dict[str, float]] = {}
    for s in signatures(fit.best, fit.data, linear):
        size = known[s.effect].size
        most = 0.5 * size.upper
        value = min(abs(s.sizes[size.name]) * EXPECTED / max(s.delta, 1e-9), most)
        if s.delta * value / abs(s.sizes[size.name]) >= LEAST and s.effect not in out:
            out[s.effect] = {**s.sizes, size.name: value}
    return out


def share(hits: int, n: int) -> dict[str, float | str]:
    """A rate in percent with its 95 % interval (Clopper and Pearson)."""
    low = 0.0 if not hits else float(beta.ppf(0.025, hits, n - hits + 1))
    high = 1.0 if hits == n else float(beta.ppf(0.975, hits + 1, n - hits))
    return {"value": 100 * hits / n, "low": 100 * low, "high": 100 * high, "unit": "%"}


@dataclass
class Score:
    """Counts of one model: what was asked, and what was answered."""

    alarms: int = 0
    nulls: int = 0
    cases: int = 0
    found: int = 0
    right: int = 0
    inside: int = 0
    alike: tuple[int, ...] = ()

    def row(self) -> tuple[str, ...]:
        """As a row of the table."""
        of_found = (f"{n} of {self.found}" for n in (self.right, self.inside))
        of_all = f"{self.alarms} of {self.nulls}", f"{self.found} of {self.cases}"
        return *of_all, *of_found, f"{np.mean(self.alike or (0,)):.1f}"

    def sound(self, recording: mc.Recording, settings: DiagnosisSettings) -> None:
        """A recording that lacks nothing."""
        self.nulls += 1
        self.alarms += detect(recording, settings).p_value < LEVEL

    def missing(self, name: str, recording: mc.Recording, settings: DiagnosisSettings) -> None:
        """A recording with an effect."""
        d = diagnose(recording, settings)
        self.cases += 1
        if not d.detected:
            return
        self.found += 1
        first, sets = d.causes[0], [[set(g) for g in c.alternatives] for c in d.causes]
        self.inside += any(isinstance(k, int) and any(name in g for g in sets[k]) for k in d.credible_set)
        if first.probability > d.unknown_probability and len(sets[0]) == 1 and name in sets[0][0]:
            self.right += 1
            self.alike += (len(sets[0][0]),)
        else:
            print(f"  {name}: {first.effects} {first.probability:.2f}, outside {d.unknown_probability:.2f}", flush=True)


def scored(e: Experiment, args: argparse.Namespace) -> Score:
    """The score of one model; sizes with which the loop is unstable are reduced."""
    model, rng = model_of(e.model), np.random.default_rng([args.seed, len(e.model)])
    assert model is not None
    shapes = library_of(model).shape_parameters

    def drawn(sizes: Mapping[str, float], *effects: str) -> dict[str, float]:
        theta = np.clip(model.truth * rng.uniform(1 - SPREAD, 1 + SPREAD, len(model.names)), model.lower, model.upper)
        for smaller in 0.8 ** np.arange(20):
            acting = {n: x if n in shapes else smaller * x for n, x in sizes.items()}
            with contextlib.suppress(FallsError):
                body_with_effects(model, theta, effects, acting)
                break
        return {**dict(zip(model.names, theta.tolist(), strict=True)), **acting}

    (pilot,) = recorded(e, model, [drawn({})], args.seed + 1000)
    asked = [("", {})] * args.nulls + [x for x in sizes_to_ask(e, model, pilot).items() for _ in range(args.each)]
    recordings = recorded(e, model, [drawn(sizes, *([name] if name else [])) for name, sizes in asked], args.seed)
    out, settings = Score(), DiagnosisSettings(fast=True, asked=CAUSE_ONLY, fmax=e.fmax)
    for k, ((name, _), recording) in enumerate(zip(asked, recordings, strict=True)):
        if name:
            out.missing(name, recording, replace(settings, seed=k))
        else:
            out.sound(recording, replace(settings, seed=k))
    return out


def main() -> None:
    """Simulate, diagnose, score and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nulls", type=int, default=34, help="recordings of each model that lack nothing")
    parser.add_argument("--each", type=int, default=1, help="recordings of each effect")
    parser.add_argument("--models", nargs="*", default=[e.model for e in EXPERIMENTS])
    parser.add_argument("--seed", type=int, default=1)
    measured.add_option(parser)
    args = parser.parse_args()
    scores: dict[str, Score] = {}
    header = ["model", "false alarms", "found", "cause right", "in the 95 % set", "effects named as one"]
    for e in (e for e in EXPERIMENTS if e.model in args.models):
        scores[e.model] = scored(e, args)
        rows = [[name, *s.row()] for name, s in scores.items()]
        print(table(header, rows), flush=True)
        total = {k: sum(getattr(s, k) for s in scores.values()) for k in ("alarms", "nulls", "cases", "found", "right")}
        total["inside"] = sum(s.inside for s in scores.values())
        of = {"alarms": "nulls", "found": "cases", "right": "found", "inside": "found"}
        values = {k: share(total[k], total[n]) for k, n in of.items() if total[n]}
        values |= {k: {"value": total[k]} for k in ("nulls", "cases")}
        measured.write(args.json, values, {"by_model": (header, rows)})


if __name__ == "__main__":
    main()
