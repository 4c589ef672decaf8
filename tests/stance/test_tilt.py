"""Tilts of the surface and of the visual scene: what the senses make of them, and which weights a tilt identifies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from mcstudy.effect_library import library
from mcstudy.errors import ModelError
from mcstudy.stance.body import WEIGHTS, Body, one_segment, tilt_of, two_segment
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf, frf_jacobian, neural_controllers, noise_response
from mcstudy.stance.rules import Rules
from mcstudy.stance.simulate_spectral import stimulus_sway
from mcstudy.stance.simulate_time import simulate, with_derivatives
from mcstudy.stance.stability import growth_rate
from mcstudy.stance.stimulus import Prts

F = np.array([0.023, 0.1, 0.41, 1.2, 3.0, 8.0])
SEGMENTS = {"m1": 22.7, "h1": 0.4665, "I1": 1.716, "m2": 48.43, "h2": 0.329055, "I2": 3.2919, "L1": 0.84353}
G, PERIOD_S, STEP_S = 9.81, 4.0, 0.002


def fourier(samples: np.ndarray, f: float) -> np.ndarray:
    t = STEP_S * np.arange(len(samples))
    return np.tensordot(np.exp(-2j * np.pi * f * t), samples, 1)


def beyond(x: float, threshold: float) -> float:
    return float(np.sign(x) * max(abs(x) - threshold, 0.0))


def newton(
    p: dict[str, float],
    senses: dict[str, float],
    surface: np.ndarray,
    scene: np.ndarray,
    dead: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """Angles (n, 2) of legs and trunk in space, from Newton's law of two rods, each sense a torque of its own.

    Written without the model: segment angles in space, balances about the ankle and the hip with the reaction at the
    hip eliminated, torques at the joints from muscles that are stretched (passive) and from three senses with their
    weights. One step is exact for a constant torque; the torque is that of the middle of the step (second order).
    ``dead``: thresholds of what is felt, angle (rad) and rate (rad/s).
    """
    m1, h1, I1, m2, h2, I2, L1 = SEGMENTS.values()
    inertia = np.array([[I1 + m1 * h1**2 + m2 * L1**2, m2 * L1 * h2], [m2 * L1 * h2, I2 + m2 * h2**2]])
    falling = np.array([[(m1 * h1 + m2 * L1) * G, 0.0], [0.0, m2 * h2 * G]])
    # muscles at the hip push the trunk and, the other way, the legs
    push = np.array([[1.0, -1.0], [0.0, 1.0]])
    stretch_hip = np.array([-1.0, 1.0])
    passive = -p["Kpas1"] * np.diag([1.0, 0.0]) - p["Kpas2"] * np.outer([-1.0, 1.0], stretch_hip)
    free = np.zeros((4, 4))
    free[:2, 2:] = np.eye(2)
    free[2:, :2] = np.linalg.solve(inertia, falling + passive)
    by_torque = np.vstack([np.zeros((2, 2)), np.linalg.inv(inertia)])
    whole = np.zeros((6, 6))
    whole[:4, :4], whole[:4, 4:] = free, by_torque
    step = expm(whole * STEP_S)
    late = [round(p["Td1"] / STEP_S), round(p["Td2"] / STEP_S)]
    n = len(surface)
    turned = [np.gradient(x, STEP_S) for x in (surface, scene)]
    x = np.zeros((n, 4))

    def felt(i: int) -> tuple[float, float, float, float]:
        """What the senses say of the legs together, its rate, and angle and rate of the hip, at the instant i / 2."""
        a, b = i // 2, (i + 1) // 2
        if a < 0:
            return 0.0, 0.0, 0.0, 0.0
        leg, trunk, leg_rate, trunk_rate = (x[a] + x[b]) / 2
        floor, room = ((s[a] + s[b]) / 2 for s in (surface, scene))
        floor_rate, room_rate = ((s[a] + s[b]) / 2 for s in turned)
        ears, ankles, eyes = (leg, leg_rate), (leg - floor, leg_rate - floor_rate), (leg - room, leg_rate - room_rate)
        weighted = [
            senses["ears"] * e + senses["ankles"] * a + senses["eyes"] * v
            for e, a, v in zip(ears, ankles, eyes, strict=True)
        ]
        every = (weighted[0], weighted[1], trunk - leg, trunk_rate - leg_rate)
        return tuple(beyond(x, dead[k % 2]) for k, x in enumerate(every))

    for k in range(n - 1):
        legs, leg_rate, hip, hip_rate = felt(2 * (k - late[0]) + 1)
        ankle = -p["K11"] * legs - p["B11"] * leg_rate - p["K21"] * hip - p["B21"] * hip_rate
        legs, leg_rate, hip, hip_rate = felt(2 * (k - late[1]) + 1)
        hips = -p["K12"] * legs - p["B12"] * leg_rate - p["K22"] * hip - p["B22"] * hip_rate
        ankle += p["Kpas1"] * (surface[k] + surface[k + 1]) / 2
        x[k + 1] = step[:4, :4] @ x[k] + step[:4, 4:] @ (push @ [ankle, hips])
    return x[:, :2]


@pytest.mark.parametrize("kind", WEIGHTS)
def test_the_closed_form_is_newtons_law_with_three_senses(kind: str) -> None:
    model = two_segment(Body.from_segments(**SEGMENTS), kind)
    p = dict(zip(model.names, model.truth, strict=True))
    senses = {"ears": 0.3, "ankles": 0.7, "eyes": 0.0}
    if kind == "visual_tilt":
        senses = {"ears": 0.25, "ankles": 0.55, "eyes": 0.2}
    assert senses["ankles" if kind == "surface_tilt" else "eyes"] == p[WEIGHTS[kind].name]
    t = np.arange(0, 5 * PERIOD_S, STEP_S)
    tones = np.array([1, 2, 5, 9]) / PERIOD_S
    tilt = sum(0.01 * (1 - np.exp(-(t**2))) * np.sin(2 * np.pi * f * t + f) for f in tones)
    still = np.zeros(t.size)
    legs, trunk = newton(p, senses, *((tilt, still) if kind == "surface_tilt" else (still, tilt))).T
    last = -round(PERIOD_S / STEP_S)
    for f, H in zip(tones, frf(model, model.truth, tones), strict=True):
        u = fourier(tilt[last:], f)
        assert [fourier(legs[last:], f) / u, fourier((trunk - legs)[last:], f) / u] == pytest.approx(H, rel=2e-3)


@pytest.mark.parametrize("kind", WEIGHTS)
@pytest.mark.parametrize("make", [one_segment, two_segment])
def test_both_simulators_give_the_closed_form(kind: str, make) -> None:
    model = make(stimulus=kind)
    prts = Prts(stages=4, state_s=0.2, rate_hz=50.0, amplitude=0.01)
    cycle = prts.waveform()
    spectrum = np.fft.rfft(cycle) / (1 + (np.fft.rfftfreq(cycle.size, 1 / 50.0) / 3.0) ** 4)
    smooth = np.fft.irfft(spectrum, cycle.size)
    steady = stimulus_sway(model, model.truth, smooth, 50.0)
    sway = simulate(model, model.truth, np.tile(with_derivatives(smooth, 50.0), (3, 1)), 50.0, substeps=4)
    assert np.abs(sway.theta[-cycle.size :] - steady).max() < 1e-6 * np.abs(steady).max()
    with pytest.raises(ModelError, match="senses derivatives of the stimulus"):
        simulate(model, model.truth, smooth, 50.0)


def test_a_threshold_acts_on_what_the_senses_report_together() -> None:
    """Half a period of a tilt whose sway is of the size of the thresholds, against Newton's law with three senses."""
    model = two_segment(Body.from_segments(**SEGMENTS), "surface_tilt")
    p, dead = dict(zip(model.names, model.truth, strict=True)), (1e-3, 5e-3)
    rate = 1 / STEP_S
    t = np.arange(0, 2 * PERIOD_S, STEP_S)
    tilt = with_derivatives(0.01 * np.sin(2 * np.pi * t / PERIOD_S) ** 2, rate)[: t.size // 2]
    still = np.zeros(len(tilt))
    legs, trunk = newton(p, {"ears": 0.3, "ankles": 0.7, "eyes": 0.0}, tilt[:, 0], still, dead).T
    rules = Rules(dead_angle=(dead[0],) * 2, dead_rate=(dead[1],) * 2)
    sway = simulate(model, model.truth, tilt, rate, rules=rules).theta
    linear = simulate(model, model.truth, tilt, rate).theta
    found = np.column_stack([legs, trunk - legs])
    assert np.abs(sway - found).max() < 2e-3 * np.abs(found).max()
    assert np.abs(linear - found).max() > 0.2 * np.abs(found).max()
    whole = simulate(model, model.truth, tilt, rate, rules=Rules(dead_angle=(1e-15, 1e-15))).theta
    assert np.abs(whole - linear).max() < 1e-10 * np.abs(linear).max()
    with pytest.raises(ModelError, match="senses derivatives of the stimulus"):
        simulate(model, model.truth, tilt[:, 0], rate, rules=rules)


@pytest.mark.parametrize("kind", WEIGHTS)
@pytest.mark.parametrize("name", ["stimulus_delay", "joint_stretch_frame"])
def test_both_simulators_give_the_closed_form_of_effects_that_meet_a_tilt(kind: str, name: str) -> None:
    model = library.apply(two_segment(stimulus=kind), name)
    theta = np.r_[model.truth[:-1], 0.035 if name == "stimulus_delay" else 0.4]
    prts = Prts(stages=4, state_s=0.2, rate_hz=50.0, amplitude=0.01)
    spectrum = np.fft.rfft(prts.waveform())
    smooth = np.fft.irfft(spectrum / (1 + (np.arange(spectrum.size) / prts.period_s / 3.0) ** 4), prts.samples)
    steady = stimulus_sway(model, theta, smooth, 50.0)
    sway = simulate(model, theta, np.tile(with_derivatives(smooth, 50.0), (3, 1)), 50.0, substeps=4).theta
    assert np.abs(sway[-prts.samples :] - steady).max() < 1e-5 * np.abs(steady).max()


def test_the_sequence_of_laboratories_is_a_velocity_whose_integral_has_odd_harmonics_only() -> None:
    """80 states of 0.25 s (Peterka 2002): the rate of the tilt is -v, 0 or +v, and the tilt is its integral."""
    prts = Prts(stages=4, state_s=0.25, rate_hz=100.0, amplitude=np.deg2rad(0.5), convention="peak_to_peak")
    tilt = prts.waveform()
    assert (prts.states, prts.period_s) == (80, 20.0)
    assert np.ptp(tilt) == pytest.approx(np.deg2rad(0.5), rel=1e-12)
    steps = np.diff(np.r_[tilt, tilt[0]]).reshape(80, 25)
    assert np.abs(steps - steps[:, :1]).max() < 1e-15
    levels = np.unique(np.round(steps[:, 0] / np.abs(steps).max(), 9))
    assert levels.tolist() == [-1.0, 0.0, 1.0]
    power = np.abs(np.fft.rfft(tilt)) ** 2
    assert power[::2].max() < 1e-20 * power.max()
    # Every odd line of the velocity has the power of an m-sequence; its zeros of the hold are at multiples of 4 Hz.
    k = np.arange(1, 60, 2)
    sequence = np.fft.fft(steps[:, 0])[k]
    assert np.abs(sequence) == pytest.approx(np.full(k.size, np.abs(sequence[0])), rel=1e-9)


@pytest.mark.parametrize("kind", WEIGHTS)
@pytest.mark.parametrize("make", [one_segment, two_segment])
def test_derivatives_agree_with_central_differences(kind: str, make) -> None:
    model = make(stimulus=kind)
    theta = model.truth
    H, J = frf_jacobian(model, theta, F)
    for j, value in enumerate(theta):
        slopes = []
        for step in (1e-3 * value, 5e-4 * value):
            e = step * np.eye(theta.size)[j]
            ahead, back, far, behind = (frf(model, theta + k * e, F) for k in (1, -1, 2, -2))
            slopes.append((8 * (ahead - back) - (far - behind)) / (12 * step))
        expected = (16 * slopes[1] - slopes[0]) / 15
        assert np.abs(J[..., j] - expected).max() < 1e-8 * (np.abs(expected).max() + np.abs(H).max() / value)


@pytest.mark.parametrize("kind", WEIGHTS)
def test_a_tilt_leaves_loop_noise_and_controllers_as_they_are(kind: str) -> None:
    tilted, plain = two_segment(stimulus=kind), two_segment()
    assert tilted.names[:12] == plain.names
    assert tilted.weights == (WEIGHTS[kind].name,)
    assert tilt_of(tilted) == kind
    assert (plain.weights, tilt_of(plain)) == ((), None)
    for theta in (tilted.truth, np.r_[plain.truth, 0.1]):
        assert growth_rate(tilted, theta) == growth_rate(plain, plain.truth)
        for of in (neural_controllers, noise_response):
            assert np.array_equal(of(tilted, theta, F), of(plain, plain.truth, F))


def test_a_slow_tilt_is_followed_as_far_as_the_weight_says() -> None:
    """At rest the one-segment balance is (K + Kpas - mgh) theta = (W K + Kpas) surface, or W K scene."""
    mgh = Body().mgh
    for kind in WEIGHTS:
        model = one_segment(stimulus=kind)
        K, _, Kpas, _, W = model.truth
        drive = W * K + (Kpas if kind == "surface_tilt" else 0.0)
        assert frf(model, model.truth, np.array([1e-7]))[0, 0].real == pytest.approx(drive / (K + Kpas - mgh), rel=1e-6)


def test_with_proprioception_alone_and_without_gravity_a_slow_surface_is_followed_exactly() -> None:
    model = two_segment(stimulus="surface_tilt").with_values({"Wprop": 1.0})
    weightless = replace(model, terms=tuple(t for t in model.terms if t.gain or t.order))
    assert frf(weightless, weightless.truth, np.array([1e-6]))[0] == pytest.approx([1.0, 0.0], abs=1e-5)


def sensitivity(model: Model) -> np.ndarray:
    """Relative responses by relative parameters, real and imaginary parts as rows."""
    f = np.geomspace(0.02, 8.0, 40)
    H, J = frf_jacobian(model, model.truth, f)
    S = (J / np.abs(H)[..., None] * model.truth).reshape(-1, len(model.names))
    return np.vstack([S.real, S.imag])


def with_every_weight(kind: str) -> Model:
    """The model with the weights of ears, ankles and eyes as parameters of their own; they need not sum to one."""
    own = {"Wvest": 0.25, "Wprop": 0.55, "Wvis": 0.2}
    base = two_segment()
    seen = {"surface_tilt": "Wprop", "visual_tilt": "Wvis"}[kind]
    terms = []
    for t in base.terms:
        if t.sense == "stimulus":
            continue
        if t.noisy and t.sense == "theta1":
            terms += [Term(t.row, "theta1", (*t.gain, w), t.order, t.delay, noisy=True) for w in own]
            terms.append(Term(t.row, "stimulus", (*t.gain, seen), t.order, t.delay, noisy=True))
        else:
            terms.append(t)
            if t.sense == "theta1" and t.gain and kind == "surface_tilt":
                terms.append(Term(t.row, "stimulus", t.gain))
    weights = [Parameter(name, "", value, 0.0, 1.0) for name, value in own.items()]
    return Model("senses", (*base.parameters, *weights), tuple(terms))


def rank(S: np.ndarray) -> int:
    return int((np.linalg.svd(S, compute_uv=False) > 1e-9 * np.linalg.norm(S)).sum())


def test_a_tilt_identifies_its_own_weight_and_the_sum_of_the_others() -> None:
    every = {kind: sensitivity(with_every_weight(kind)) for kind in WEIGHTS}
    for kind, weight in WEIGHTS.items():
        # One tilt: all 12 parameters and its weight, when the weights sum to one.
        assert rank(sensitivity(two_segment(stimulus=kind))) == 13
        # Without that condition the sum of the weights and the gains have the same effect: 15 parameters, rank 13.
        names = with_every_weight(kind).names
        assert rank(every[kind]) == 13
        others = [names.index(w) for w in ("Wvest", "Wprop", "Wvis") if w != weight.name]
        assert rank(every[kind][:, others]) == 1
    # Both tilts: each weight, but still not their common factor.
    both = np.vstack([every[kind] for kind in WEIGHTS])
    assert rank(both) == 14
    # What is left is that factor: the eight active gains of theta1 up, the weights down.
    null = np.linalg.svd(both)[2][-1]
    names = with_every_weight("surface_tilt").names
    moved = {n for n, x in zip(names, null, strict=True) if abs(x) > 1e-6}
    assert moved == {"K11", "K12", "B11", "B12", "Wvest", "Wprop", "Wvis"}
    # A torque at the ankle says nothing of any weight.
    assert two_segment().weights == ()


def test_what_a_single_pendulum_or_a_threshold_cannot_have_is_refused() -> None:
    with pytest.raises(ModelError, match="expected one of ankle_torque, surface_tilt, visual_tilt for one_segment"):
        one_segment(stimulus="hip_torque")
    reflex = library.apply(two_segment(stimulus="surface_tilt"), "short_latency_reflex")
    with pytest.raises(ModelError, match="all active feedback of theta1 to sense the tilt with the weight Wprop"):
        simulate(reflex, reflex.truth, np.zeros((20, 3)), 100.0, rules=Rules(dead_angle=(0.01, 0.01)))
