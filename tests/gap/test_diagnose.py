"""The whole diagnosis of time-domain recordings: verdict, JSON, and mistakes that are caught."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import InputError, RecordingError
from mcstudy.files import schema
from mcstudy.gap.diagnose import detect, diagnose
from mcstudy.gap.document import document
from mcstudy.gap.questions.parameters import (
    MOSTLY_PRIOR,
    PRIOR_EXPLAINED,
    SOURCES,
    SOURCES_EXPLAINED,
    prior_share,
    sources,
)
from mcstudy.gap.settings import CAUSE_ONLY, FAST, DiagnosisSettings
from mcstudy.gap.tables import text
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.labels import refuse
from mcstudy.recordings.recording import Recording, Suspicion, Trial
from mcstudy.results.diagnosis import Diagnosis
from mcstudy.spectra.measure import measure
from mcstudy.stance.body import two_segment
from mcstudy.stance.simulate_spectral import stimulus_sway
from mcstudy.stance.stimulus import Prts

MODEL = two_segment()
PROTOCOL = Protocol(waveform=Prts(rate_hz=100.0))


@pytest.fixture(scope="module")
def lagging() -> Recording:
    rng = np.random.default_rng(4)
    return simulate_recording(
        PROTOCOL, 0.95 * MODEL.truth, rng, effects=["sensor_lag_theta1"], sizes={"tau_theta1": 0.01}, name="lagging"
    )


@pytest.fixture(scope="module")
def out(lagging: Recording) -> Diagnosis:
    return Diagnosis.of(diagnose(lagging, DiagnosisSettings(fast=True, seed=3)))


def test_json_conforms_to_its_schema_and_says_what_the_object_says(out: Diagnosis) -> None:
    plain = json.loads(json.dumps(out.to_dict(), allow_nan=False))
    schema.validate("diagnosis", plain, "diagnosis")
    assert plain["detected"] is True
    assert plain["causes"][0]["effects"] == list(out.causes[0].effects)
    assert "sensor_lag_theta1" in plain["causes"][0]["alternatives"][0]
    size = plain["causes"][0]["size"]["tau_theta1"]
    assert abs(size["estimate"] - 0.01) < 4 * size["se"]
    assert plain["place"]["sensor"] > 0.5
    assert plain["closed"]["fraction"] > 0.8
    assert plain["sway_rms_deg"]["after"] < plain["sway_rms_deg"]["before"]
    assert [p["name"] for p in plain["parameters"]] == list(MODEL.names)
    said = out.verdict()
    assert said.startswith("A gap beyond noise")
    assert "sensor_lag_theta1" in said
    assert plain["sway_noise_deg"][0] < plain["sway_rms_deg"]["floor"] < plain["sway_noise_deg"][1]
    assert "<table>" in out._repr_html_()


def test_questions_that_nobody_asks_leave_the_other_answers_as_they_are(lagging: Recording, out: Diagnosis) -> None:
    full, less = out.to_dict(), document(diagnose(lagging, DiagnosisSettings(fast=True, seed=3, asked=CAUSE_ONLY)))
    schema.validate("diagnosis", less, "diagnosis")
    assert full["nearest"]
    assert full["closed"]
    assert not less["nearest"]
    assert not less["closed"]
    for cause in (*full["causes"], *less["causes"]):
        cause.pop("likeness")
    assert {k for k in full if full[k] != less[k]} == {"verdict", "nearest", "closed"}
    assert "No mechanism" not in less["verdict"]


def test_same_seed_same_diagnosis_and_bootstrap_agrees(lagging: Recording, out: Diagnosis) -> None:
    first, again = out.to_dict(), document(diagnose(lagging, DiagnosisSettings(fast=True, seed=3)))
    assert first == again
    slow = diagnose(lagging, DiagnosisSettings(bootstrap=100, seed=3))
    assert slow.detected
    assert slow.method.null == "bootstrap with refits"
    assert slow.causes[0].effects == tuple(first["causes"][0]["effects"])


def test_exchanged_channels_are_refused(lagging: Recording) -> None:
    exchanged = replace(lagging, trials=tuple(replace(t, theta=t.theta[:, ::-1].copy()) for t in lagging.trials))
    with pytest.raises(RecordingError, match="exchanged"):
        diagnose(exchanged, FAST)


def test_a_diagnosis_and_its_parts_show_themselves_in_a_few_lines(lagging: Recording, out: Diagnosis) -> None:
    lines = measure(lagging)
    assert lines.even is not None
    parts = (
        out,
        out.detection,
        out.causes[0],
        out.causes[0].fitted,
        lines,
        lines.even,
        detect(lagging, FAST),
        lagging,
    )
    for shown in parts:
        assert len(repr(shown)) < 2000, type(shown)
    for shown in (out, lines, lines.even, lagging, lagging.trials[0]):
        assert "</table>" in shown._repr_html_()
    shown_text = repr(out)
    assert "lagging" in shown_text
    assert "a gap beyond noise (p <" in shown_text
    assert re.search(r"sensor_lag_theta1 \d+ %", shown_text)


def test_a_parameter_says_whether_its_value_is_the_prior_s_or_a_bound_s(lagging: Recording, out: Diagnosis) -> None:
    """At 1.2 Hz the data say little about delays and the passive ankle; the prior's values must not pass as theirs."""
    low = Diagnosis.of(diagnose(lagging, DiagnosisSettings(fast=True, fmax=1.2)))
    base = low.base
    alone = replace(base, prior=base.prior._replace(scale=1e4 * base.prior.scale))
    share = 1 - np.diag(base.covariance) / np.diag(alone.covariance)
    by_name = {s.name: s for s in low.shifts}
    expected = {n: "prior" if x >= MOSTLY_PRIOR else "data" for n, x in zip(base.model.names, share, strict=True)}
    assert {n: s.without_from for n, s in by_name.items()} == expected
    assert by_name["Kpas1"].without_from == "prior"
    assert (by_name["K11"].added_from is None) == (low.leading is None)  # without a gap there is no leading cause
    assert {s.added_from for s in out.shifts} <= set(SOURCES)
    assert re.search(r"Kpas1 .* mostly prior +N m/rad", text(low))
    shown = " ".join(text(low).split())
    assert SOURCES_EXPLAINED["prior"] in shown
    assert PRIOR_EXPLAINED in shown
    assert SOURCES_EXPLAINED["bound"] not in shown  # explained only where it occurs
    assert "mostly prior" in low._repr_html_()
    plain = low.to_dict()
    schema.validate("diagnosis", plain, "diagnosis")
    assert plain["parameters"][8]["without_from"] == "prior"
    # What a profile without a prior leaves open must not pass as the data's: active stiffness trades for passive one.
    whole = out.base
    assert dict(zip(whole.model.names, sources(whole), strict=True))["K11"] == "prior"
    assert prior_share(whole)[whole.model.names.index("K21")] < MOSTLY_PRIOR
    tight = base.model.with_bounds({"K11": (base.theta[0], 5000.0)})
    assert sources(replace(base, model=tight))[0] == "bound"


def exchanged(trial: Trial) -> Trial:
    return replace(trial, theta=trial.theta[:, ::-1].copy())


def test_what_one_check_noted_does_not_hide_what_another_would_find(lagging: Recording) -> None:
    """A stuck sensor, or an amplitude that fits nothing, and exchanged angles at once."""
    for noted in (Suspicion("stuck", "theta2", "stuck"), Suspicion("amplitude", "stimulus", "odd", 1.0)):
        both = replace(lagging, trials=tuple(map(exchanged, lagging.trials)), suspicions=(noted,))
        for accept in ((), ("stuck", "amplitude")):
            with pytest.raises(RecordingError, match="exchanged"):
                diagnose(both, DiagnosisSettings(fast=True, accept=accept))
    stuck = exchanged(lagging.trials[0])
    stuck.theta[1000:1400, 1] = stuck.theta[1000, 1]
    with pytest.raises(RecordingError, match=r"exchanged .* accept 'swapped'") as caught:
        checked_recording(replace(lagging, trials=(stuck, exchanged(lagging.trials[1]))))
    codes = re.findall(r"'(\w+)'", str(caught.value))
    accepted = diagnose(
        replace(lagging, trials=(stuck, exchanged(lagging.trials[1]))), DiagnosisSettings(fast=True, accept=codes)
    )
    assert [w for w in accepted.warnings if "is constant for" in w]
    assert [w for w in accepted.warnings if "exchanged" in w]


def test_one_mislabelled_trial_does_not_hide_among_others(lagging: Recording) -> None:
    first, second = lagging.trials
    mixed = replace(lagging, trials=(first, exchanged(second)))
    with pytest.raises(RecordingError, match=r"trial 2: theta1, theta2: seems to be exchanged|accept .*'swapped'"):
        diagnose(mixed, FAST)
    good = [lagging.select((0,)), lagging.select((0,)), lagging.select((1,))]
    with pytest.raises(RecordingError, match="'swapped'"):
        diagnose([*good, replace(good[0], trials=(exchanged(first),))], FAST)


def test_every_suspicion_needs_its_own_code_and_codes_are_known(lagging: Recording) -> None:
    with pytest.raises(InputError, match=r"accept: expected codes among degrees, .*, got swaped"):
        diagnose(lagging, DiagnosisSettings(fast=True, accept=["swaped"]))
    doubts = [Suspicion(c, "theta1, theta2", f"looks {c}", 20.0) for c in ("swapped", "sign")]
    with pytest.raises(RecordingError, match=r"looks swapped .*accept 'swapped' and 'sign' to keep the labels"):
        refuse(doubts)
    with pytest.raises(RecordingError, match=r"looks sign .*accept 'sign' to keep the labels"):
        refuse(doubts, ["swapped"])
    refuse(doubts, ["swapped", "sign"])


def test_what_cannot_be_diagnosed_gets_one_line(lagging: Recording) -> None:
    trial = lagging.trials[0]
    broken = replace(trial, theta=trial.theta.copy())
    broken.theta[7, 0] = np.nan
    period = PROTOCOL.waveform.waveform()
    repeated = np.tile(stimulus_sway(MODEL, MODEL.truth, period, 100.0), (4, 1))
    still = replace(lagging, trials=(Trial(np.tile(period, 4), repeated, 5.0),))
    pulse = np.zeros(trial.samples)
    pulse[3000] = 1.0
    short = Trial(trial.stimulus[:20], trial.theta[:20])
    aperiodic = replace(lagging, period_s=None)
    with_trials = lambda *trials: replace(aperiodic, trials=trials)  # noqa: E731
    for recording, options, message in (
        (replace(lagging, trials=(broken,)), {}, "theta1: 1 of .* not numbers"),
        (still, {}, "expected noise of at least 1e-05 of the responses"),
        (with_trials(replace(trial, stimulus=pulse, amplitude=None)), {}, "one that varies throughout the trial"),
        (with_trials(trial, short), {}, "the shortest trial has 0.2 s"),
        (aperiodic, {"fmax": 60.0}, "100 Hz does not reach lines up to 60 Hz"),
        (aperiodic, {"fmax": 0.01}, "at least 4 lines up to fmax = 0.01 Hz, got 0"),
        (lagging, {"fmax": float("nan")}, "fmax: expected a positive number of Hz, got nan"),
        (lagging, {"fmax": 0.01}, "at least 4 lines up to fmax = 0.01 Hz, got 0"),
        ([], {}, "recordings: expected at least one"),
    ):
        with pytest.raises(RecordingError, match=message):
            diagnose(recording, DiagnosisSettings(fast=True, **options))
    with pytest.raises(InputError, match="bootstrap: expected at least 50 null samples, got 0"):
        diagnose(lagging, DiagnosisSettings(bootstrap=0))


def test_degrees_declared_as_radians_are_refused(lagging: Recording) -> None:
    wrong = replace(lagging, trials=tuple(replace(t, theta=np.rad2deg(t.theta)) for t in lagging.trials))
    with pytest.raises(RecordingError, match="deg"):
        diagnose(wrong, FAST)


def test_trials_of_one_kind_are_pooled(lagging: Recording) -> None:
    both = diagnose([lagging.select((0,)), lagging.select((1,))], FAST)
    assert both.method.trials == 2
    assert both.lines.counts == (len(both.lines),)


def test_the_prior_and_the_bayes_factor_are_stated_and_anyone_can_apply_his_own(
    lagging: Recording, out: Diagnosis, plain_recordings: list[Recording]
) -> None:
    for recording, seed, priors in ((lagging, 3, (0.1, 0.7)), (plain_recordings[0], 0, (0.7,))):
        default = out if recording is lagging else diagnose(recording, DiagnosisSettings(fast=True, seed=seed))
        assert document(default)["prior"] == {
            "none": 0.30,
            "single": 0.52,
            "pair": 0.03,
            "unknown": 0.11,
            "beside": 0.04,
        }
        for p in priors:
            other = diagnose(recording, DiagnosisSettings(fast=True, seed=seed, prior_none=p))
            schema.validate("diagnosis", document(other), "diagnosis")
            assert sum(other.prior.values()) == pytest.approx(1)
            assert other.prior["single"] / other.prior["unknown"] == pytest.approx(0.52 / 0.11)
            assert other.none_log_factor == pytest.approx(default.none_log_factor, abs=1e-9)
            odds = p / (1 - p) * np.exp(default.none_log_factor)
            assert other.none_probability == pytest.approx(odds / (1 + odds), rel=1e-9, abs=1e-12)
            assert (other.p_value, other.closed) == (default.p_value, default.closed)
            ratio = [c.probability / (1 - d.none_probability) for d in (default, other) for c in d.causes[:1]]
            assert ratio[0] == pytest.approx(ratio[1], rel=1e-9)
        assert "Prior probabilities: no missing effect 30 %, one effect of the library 52 %" in " ".join(
            text(default).split()
        )


def test_a_bayes_factor_beyond_all_evidence_is_a_limit(out: Diagnosis) -> None:
    said = [" ".join(text(replace(out, none_log_factor=x)).split()) for x in (-900.0, -1.0, 900.0)]
    assert "against all others: below 1e-06;" in said[0]
    assert "against all others: 0.37;" in said[1]
    assert "against all others: above 1e+06;" in said[2]


@pytest.mark.parametrize("p", [0.0, 1.0, -0.1, float("nan"), "0.3"])
def test_a_prior_that_is_no_probability_is_refused_before_the_work(lagging: Recording, p: float) -> None:
    with pytest.raises(InputError, match=r"prior_none: expected a probability above 0 and below 1"):
        diagnose(lagging, DiagnosisSettings(fast=True, prior_none=p))
