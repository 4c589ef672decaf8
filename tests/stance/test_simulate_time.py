"""The time-domain simulator is the closed form's equal where both can go, and its rules do what they say."""

import numpy as np
import pytest

from mcstudy.errors import ModelError
from mcstudy.stance.body import Body, one_segment, two_segment
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.noise import SensorNoise, record, record_frequencies
from mcstudy.stance.response import frf, noise_response
from mcstudy.stance.rules import Rules, reweighted
from mcstudy.stance.simulate_time import simulate, with_derivatives
from mcstudy.stance.stability import growth_rate
from mcstudy.stance.stimulus import Prts

MODEL = two_segment()
ONE = Monomial(1.0, 0)
LINES, PERIOD = np.array([1, 3, 7, 11, 19, 27]), 8.0  # 0.1 to 3.4 Hz


def multisine(rate, cycles):
    """A smooth stimulus with its derivatives, (n, 3)."""
    t, w = np.arange(round(cycles * PERIOD * rate)) / rate, 2 * np.pi * LINES / PERIOD
    phase, a = w * t[:, None] + np.arange(LINES.size), 1 / LINES
    return np.stack(
        [
            (a * np.sin(phase)).sum(axis=1),
            (a * w * np.cos(phase)).sum(axis=1),
            -(a * w**2 * np.sin(phase)).sum(axis=1),
        ],
        axis=1,
    )


def frf_error(model, rate=200.0, cycles=6, theta=None):
    """Largest relative error of the last cycle's FRF against the closed form."""
    theta = model.truth if theta is None else theta
    u, n = multisine(rate, cycles), round(PERIOD * rate)
    sway = simulate(model, theta, u, rate).theta[-n:]
    measured = np.fft.rfft(sway, axis=0)[LINES] / np.fft.rfft(u[-n:, 0])[LINES, None]
    expected = frf(model, theta, LINES / PERIOD)
    present = np.abs(expected).max(axis=0) > 0
    return np.abs(measured[:, present] / expected[:, present] - 1).max()


def with_filter(filt, which, parameters):
    terms = tuple(
        Term(t.row, t.sense, t.gain, t.order, t.delay, (filt.name,), t.coefficient, t.noisy) if which(t) else t
        for t in MODEL.terms
    )
    return Model(filt.name, (*MODEL.parameters, *parameters), terms, (filt,))


def added(*terms, parameters=(), filters=()):
    return MODEL.with_terms(parameters=parameters, terms=terms, filters=filters)


def resonance(detached):
    above = (Monomial(-1.0, 2),) if detached else (Monomial(6.0, 1), Monomial(225.0, 0))
    return Filter("mode", above, (Monomial(1.0, 2), Monomial(6.0, 1), Monomial(225.0, 0)))


def lag(name, parameter):
    return Filter(name, (ONE,), (ONE, Monomial(1.0, 1, ((parameter, 1),))))


TAU = Parameter("tau", "s", 0.03, 0.0, 0.2)
EXTRA = Parameter("extra", "", 5.0, -20.0, 200.0)
KINDS = {
    "two_segment": MODEL,
    "one_segment": one_segment(),
    "hip_torque": two_segment(stimulus="hip_torque"),
    "platform_translation": two_segment(stimulus="platform_translation"),
    "integral": added(
        Term("ankle", "theta1", ("extra",), -1, "Td1", coefficient=20.0, noisy=True),
        Term("hip", "theta2", ("extra",), -1, coefficient=5.0),
        parameters=[EXTRA],
    ),
    "delayed_acceleration": added(Term("ankle", "theta1", ("extra",), 2, "Td1", noisy=True), parameters=[EXTRA]),
    "undelayed_active_acceleration": added(Term("hip", "theta2s", ("extra",), 2, noisy=True), parameters=[EXTRA]),
    "low_pass_1": with_filter(lag("low", "tau"), lambda t: t.noisy and t.row == "hip", [TAU]),
    "low_pass_2": with_filter(
        Filter("low2", (ONE,), (ONE, Monomial(0.016, 1), Monomial(1e-4, 2))), lambda t: t.noisy and t.row == "hip", []
    ),
    "force_feedback": with_filter(
        Filter("force", (Monomial(1.5, 1), ONE), (Monomial(1.5, 1), ONE, Monomial(-0.5, 0))),
        lambda t: t.noisy and t.row == "ankle",
        [],
    ),
    "resonant_mass": added(
        *(Term(r, "theta2s", ("extra",), 2, filters=("mode",), coefficient=0.4) for r in ("hip", "ankle")),
        parameters=[EXTRA],
        filters=[resonance(False)],
    ),
    "loose_mass": added(
        *(Term(r, "theta2s", ("extra",), 2, filters=("mode",), coefficient=0.1) for r in ("hip", "ankle")),
        parameters=[EXTRA],
        filters=[resonance(True)],
    ),
    "filtered_delayed_acceleration": added(
        Term("ankle", "theta1", ("extra",), 2, "Td1", ("low",), noisy=True),
        parameters=[EXTRA, TAU],
        filters=[lag("low", "tau")],
    ),
    "lagged_delayed_stimulus": Model(
        "lagged",
        (*MODEL.parameters, TAU, Parameter("late", "s", 0.0173, 0.0, 0.1)),
        tuple(
            Term(t.row, t.sense, t.gain, t.order, "late", ("low",)) if t.sense == "stimulus" else t for t in MODEL.terms
        ),
        (lag("low", "tau"),),
    ),
    "output_lag": Model("out", (*MODEL.parameters, TAU), MODEL.terms, (lag("low", "tau"),), ("low", None)),
    "output_lead": Model(
        "lead",
        MODEL.parameters,
        MODEL.terms,
        (Filter("lead", (ONE, Monomial(0.1, 1), Monomial(0.01, 2)), (ONE, Monomial(0.02, 1))),),
        (None, "lead"),
    ),
    "product_of_gains": added(
        Term("hip", "theta1", ("K22", "extra"), 0, "Td2", coefficient=0.05, noisy=True), parameters=[EXTRA]
    ),
    "odd_delays": MODEL.with_values({"Td1": 0.0837, "Td2": 0.0913}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_term_agrees_with_the_closed_form(kind):
    """Largest error up to 3.4 Hz; bodies and delays alone reach 1e-9, filters of 30 ms and resonances 1e-7."""
    model = KINDS[kind]
    growth = growth_rate(model, model.truth)
    assert growth < -0.1
    assert frf_error(model, cycles=3 + int(3 / -growth)) < 1e-7


@pytest.mark.parametrize(
    "kind", ["two_segment", "odd_delays", "low_pass_1", "resonant_mass", "lagged_delayed_stimulus"]
)
def test_on_a_smooth_stimulus_the_order_of_convergence_is_five(kind):
    coarse, fine = (frf_error(KINDS[kind], rate, cycles=7) for rate in (50.0, 200.0))
    assert np.log2(coarse / fine) / 2 > 4.5


def test_a_prts_simulation_gives_the_closed_form_response():
    """The torque between samples is linear, so its spectrum is the samples' times sinc^2; then 1e-5 up to 8 Hz.

    What is left at 8 Hz is sway above the Nyquist frequency folded back (7e-6), not the solver.
    """
    prts = Prts()
    n, k = prts.samples, np.arange(1, 350, 2)
    f = k / prts.period_s
    sway = simulate(MODEL, MODEL.truth, np.tile(prts.waveform(), 2), prts.rate_hz).theta[n:]
    torque = prts.coefficients()[k] * np.sinc(f / prts.rate_hz) ** 2
    error = np.abs((np.fft.rfft(sway, axis=0) / n)[k] / torque[:, None] / frf(MODEL, MODEL.truth, f) - 1).max(axis=1)
    assert error[f < 0.41].max() < 1e-8
    assert error[f < 1.2].max() < 1e-7
    assert error.max() < 1.2e-5


def test_noise_evokes_the_same_sway_as_in_the_frequency_domain():
    """The same noise record, repeated until the transient is gone: equal coefficients line by line."""
    n, rate = 4000, 200.0
    coefficients = SensorNoise().coefficients(np.random.default_rng(5), n, rate)
    noise = record(coefficients, n)
    sway = simulate(MODEL, MODEL.truth, np.zeros(3 * n), rate, noise=np.tile(noise, (3, 1))).theta[-n:]
    f = record_frequencies(n, rate)
    lines = (f > 0) & (f < 8.0)
    expected = np.einsum("nij,nj->ni", noise_response(MODEL, MODEL.truth, f[lines]), coefficients[lines])
    measured = np.fft.rfft(sway, axis=0)[lines] / n
    assert np.abs(measured - expected).max() < 1e-6 * np.abs(expected).max()
    # Line by line; what is added is noise above the Nyquist frequency of the interpolation, folded back.
    assert np.median(np.abs(measured / expected - 1)) < 1e-4


def test_noise_through_every_order_agrees_with_the_closed_form():
    model = added(
        Term("ankle", "theta1", ("ki",), -1, "Td1", noisy=True),
        Term("ankle", "theta1", ("ka",), 2, "Td1", ("low",), noisy=True),
        Term("hip", "theta2s", ("ka",), 2, noisy=True),
        parameters=[Parameter("ki", "", 60.0, 0.0, 100.0), Parameter("ka", "", 3.0, 0.0, 9.0), TAU],
        filters=[lag("low", "tau")],
    )
    n, rate, k = 1600, 200.0, 7
    t = 2 * np.pi * k * np.arange(12 * n) / n
    for channel in (0, 1):
        noise = np.zeros((t.size, 2))
        noise[:, channel] = 0.01 * np.cos(t)
        sway = simulate(model, model.truth, np.zeros(t.size), rate, noise=noise).theta[-n:]
        response = noise_response(model, model.truth, np.array([k * rate / n]))[0, :, channel]
        assert np.fft.rfft(sway, axis=0)[k] / n / 0.005 == pytest.approx(response, rel=1e-6)


def test_steps_inside_a_sample_refine_the_same_problem():
    prts = Prts(stages=4)
    u = prts.waveform()
    noise = SensorNoise().sample(np.random.default_rng(1), u.size, prts.rate_hz)
    motor = np.random.default_rng(2).standard_normal((u.size, 2))
    runs = [
        simulate(MODEL, MODEL.truth, u, 200.0, noise=noise, rules=Rules(motor_noise=motor), substeps=m).theta
        for m in (1, 2, 6)
    ]
    distance = [np.abs(r - runs[-1]).max() / np.abs(runs[-1]).max() for r in runs]
    assert max(distance) < 1e-4
    u = multisine(50.0, 1)
    runs = [simulate(MODEL, MODEL.truth, u, 50.0, substeps=m).theta for m in (1, 2, 8)]
    assert np.abs(runs[1] - runs[2]).max() < np.abs(runs[0] - runs[2]).max() / 8


def test_simulation_is_deterministic_and_starts_from_rest():
    u = Prts(stages=4).waveform()
    first, second = (simulate(MODEL, MODEL.truth, u, 200.0) for _ in range(2))
    assert np.array_equal(first.theta, second.theta)
    assert (first.theta[0] == 0).all()
    assert (first.rate[0] == 0).all()
    assert first.theta.shape == (u.size, 2)


def test_derivatives_and_torque_of_a_record_are_those_of_the_motion():
    """Total torque from inverse dynamics is the stimulus minus active and passive feedback."""
    u = multisine(200.0, 2)
    sway = simulate(MODEL, MODEL.truth, u, 200.0)
    central = (sway.angle[2:] - sway.angle[:-2]) * 100.0
    assert np.abs(central - sway.rate[1:-1]).max() < 1e-3 * np.abs(sway.rate).max()
    body, p = Body(), dict(zip(MODEL.names, MODEL.truth, strict=True))
    lower, upper = sway.angle[:, 0], sway.angle.sum(axis=1)
    ankle = (
        body.J1 * sway.acceleration[:, 0]
        + body.C2 * sway.acceleration.sum(axis=1)
        - body.g * (body.A1 * lower + body.A2 * upper)
    )
    corrective = u[:, 0] - sway.active_torque[:, 1] - p["Kpas1"] * lower
    assert ankle == pytest.approx(corrective, abs=1e-10)


def test_with_derivatives_is_exact_for_a_band_limited_period():
    u = multisine(100.0, 1)
    assert with_derivatives(u[:, 0], 100.0) == pytest.approx(u, abs=1e-8)


# Rules


PENDULUM = one_segment()
STIFFNESS = PENDULUM.truth[0] + PENDULUM.truth[2] - Body().mgh


def ramped(level, n, rate=200.0):
    return level * np.minimum(np.arange(n) / rate / 5.0, 1.0)


def test_rules_at_their_defaults_change_no_bit():
    u = Prts(stages=4).waveform()
    noise = SensorNoise().sample(np.random.default_rng(0), u.size, 200.0)
    plain = simulate(MODEL, MODEL.truth, u, 200.0, noise=noise)
    loose = Rules(torque_limit=(1e3, 1e3), gain_drift={"K11": 0.0}, motor_noise=np.zeros((u.size, 2)))
    assert np.array_equal(plain.theta, simulate(MODEL, MODEL.truth, u, 200.0, noise=noise, rules=loose).theta)


def test_a_dead_zone_shifts_the_equilibrium_by_the_feedback_it_withholds():
    """At rest K (theta - a) + (Kpas - mgh) theta = T."""
    a, K = np.deg2rad(0.07), PENDULUM.truth[0]
    sway = simulate(PENDULUM, PENDULUM.truth, ramped(5.0, 6000), 200.0, rules=Rules(dead_angle=(a,)))
    assert sway.theta[-1, 0] == pytest.approx((5.0 + K * a) / STIFFNESS, rel=1e-8)


def test_below_both_thresholds_there_is_no_active_torque():
    n = 400
    rules = Rules(dead_angle=(1.0, 1.0), dead_rate=(1.0, 1.0))
    sway = simulate(MODEL, MODEL.truth, ramped(0.01, n), 200.0, rules=rules)
    assert 0 < np.abs(sway.theta).max() < 1.0
    assert (sway.active_torque == 0).all()
    rate_only = simulate(MODEL, MODEL.truth, ramped(0.01, n), 200.0, rules=Rules(dead_rate=(1.0, 1.0)))
    no_damping = MODEL.truth * np.array([n[0] != "B" for n in MODEL.names])
    assert np.array_equal(rate_only.theta, simulate(MODEL, no_damping, ramped(0.01, n), 200.0).theta)


def test_saturation_cuts_active_torque_at_its_limit():
    u = 3 * Prts(stages=5).waveform()
    free = simulate(MODEL, MODEL.truth, u, 200.0)
    limit = 0.95 * np.abs(free.active_torque).max(axis=0)
    cut = simulate(MODEL, MODEL.truth, u, 200.0, rules=Rules(torque_limit=(limit[0], limit[1])))
    assert np.abs(cut.active_torque).max(axis=0) == pytest.approx(limit)
    assert not np.array_equal(cut.theta, free.theta)


def test_the_active_gain_is_a_factor_on_all_active_gains():
    u = Prts(stages=4).waveform()
    active = np.array([n[0] in "KB" and not n.startswith("Kpas") for n in MODEL.names])
    scaled = np.where(active, 0.9, 1.0) * MODEL.truth
    by_rule = simulate(MODEL, MODEL.truth, u, 200.0, rules=Rules(active_gain=0.9)).theta
    assert by_rule == pytest.approx(simulate(MODEL, scaled, u, 200.0).theta, abs=1e-13)
    assert reweighted(4.0, 0.5, 1 / 3) == pytest.approx(0.5)


@pytest.mark.parametrize("exponent", [1e308, -1e308, float("nan"), float("-inf")])
def test_reweighting_without_a_finite_gain_is_refused(exponent: float) -> None:
    with pytest.raises(ModelError, match="reweighting: expected an exponent that gives a finite gain"):
        reweighted(0.5, 4.0, exponent) if exponent > 0 else reweighted(4.0, 0.5, exponent)


def test_a_drift_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ModelError, match="rules gain_drift K: expected a finite number"):
        Rules(gain_drift={"K": float("inf")})


def test_gain_drift_moves_the_equilibrium_with_the_clock():
    """K (1 + d (t/T - 1/2)) at the end is K (1 + d/2); the loop follows within its 0.3 s."""
    K, d, n = PENDULUM.truth[0], 0.4, 60000
    sway = simulate(PENDULUM, PENDULUM.truth, ramped(5.0, n), 200.0, rules=Rules(gain_drift={"K": d}))
    for at, clock in ((n // 2, 0.0), (n - 1, 0.5)):
        assert sway.theta[at, 0] == pytest.approx(5.0 / (STIFFNESS + K * d * clock), rel=2e-3)


def test_drift_reaches_filtered_and_passive_terms_too():
    model = KINDS["low_pass_1"]
    u, start, end = ramped(1.0, 3000), {"K22": 0.3, "Kpas1": 0.2}, {}
    drifting = simulate(model, model.truth, u, 200.0, rules=Rules(gain_drift=start))
    still = simulate(model, model.truth, u, 200.0, rules=Rules(gain_drift=end))
    assert 1e-4 < np.abs(drifting.theta - still.theta).max() / np.abs(still.theta).max() < 1.0


def test_motor_noise_is_one_more_torque_on_its_row():
    rng = np.random.default_rng(3)
    torque = np.cumsum(rng.standard_normal(2000)) * 0.1
    torque[0] = 0.0
    for row, stimulus in enumerate(("hip_torque", "ankle_torque")):
        motor = np.zeros((2000, 2))
        motor[:, row] = torque
        by_rule = simulate(MODEL, MODEL.truth, np.zeros(2000), 200.0, rules=Rules(motor_noise=motor)).theta
        model = two_segment(stimulus=stimulus)
        assert by_rule == pytest.approx(simulate(model, model.truth, torque, 200.0).theta, abs=1e-13)


# What cannot be simulated is said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"theta": np.zeros(3)}, "expected 12 finite parameters"),
        ({"stimulus": np.zeros((10, 2))}, "stimulus: expected shape"),
        ({"noise": np.zeros((9, 2))}, r"noise: expected shape \(10, 2\)"),
        ({"rules": Rules(motor_noise=np.zeros(10))}, "motor_noise: expected shape"),
        ({"rate_hz": 10.0}, "a delay of 0.08 s is shorter than the step of 0.1 s"),
        ({"rules": Rules(gain_drift={"K99": 0.1})}, "unknown parameter 'K99'"),
        ({"rules": Rules(gain_drift={"Td1": 0.1})}, "Td1 is not the gain of a term"),
        ({"substeps": 0}, "substeps"),
        ({"model": two_segment(stimulus="platform_translation")}, "senses derivatives of the stimulus"),
    ],
)
def test_what_cannot_be_simulated_is_said_in_one_line(arguments, message):
    call = {"model": MODEL, "theta": MODEL.truth, "stimulus": np.zeros(10), "rate_hz": 200.0, **arguments}
    with pytest.raises(ModelError, match=message) as caught:
        simulate(**call)
    assert "\n" not in str(caught.value)


def test_a_filter_too_fast_for_the_step_is_refused():
    model = KINDS["low_pass_1"]
    theta = model.truth.copy()
    theta[-1] = 1e-3
    with pytest.raises(ModelError, match="too fast for the step"):
        simulate(model, theta, np.zeros(10), 200.0)
    assert simulate(model, theta, np.zeros(10), 200.0, substeps=2).theta.shape == (10, 2)
    theta[-1] = 0.0  # no filter at all
    assert frf_error(model, theta=theta) < 1e-8


@pytest.mark.parametrize("rules", [{"dead_angle": (-1.0, 0.0)}, {"torque_limit": (np.nan, 1.0)}, {"active_gain": -1.0}])
def test_impossible_rules_are_refused(rules):
    with pytest.raises(ModelError, match=next(iter(rules))):
        Rules(**rules)
