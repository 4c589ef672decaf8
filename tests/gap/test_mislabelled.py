"""A mislabelled recording gets no physiological name, and a sound one is not called mislabelled."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from examples import module
from mcstudy_challenge.answer import from_diagnosis
from mcstudy_challenge.answer_checks import check_answer
from scipy.signal import butter, freqz

from mcstudy.effect_library.edits import body_of, exchanged_segments, gyrations
from mcstudy.effect_library.library import apply
from mcstudy.errors import RecordingError
from mcstudy.files import schema
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnose import detect, diagnose
from mcstudy.gap.questions.any_gap import GapTest
from mcstudy.gap.questions.evidence import Hypothesis, SizeEstimate, possible
from mcstudy.gap.questions.mislabelling import Labels, Mislabelled, mislabelled
from mcstudy.gap.settings import FAST, DiagnosisSettings
from mcstudy.gap.tables import text
from mcstudy.lines.base_fit import base_fit
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.reading_fits import Search
from mcstudy.lines.readings import READINGS, butterworth
from mcstudy.recordings.checks import check
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.measure import measure
from mcstudy.stance.anthropometry import segments
from mcstudy.stance.body import Body, two_segment
from pipelines.validation.mislabelled_recordings import MISLABELLINGS, RATE_HZ, Sound, sound

BY_NAME = {m.name: m for m in MISLABELLINGS}


@pytest.fixture(scope="module")
def person() -> Sound:
    return sound(1)


@pytest.fixture(scope="module")
def tested(person: Sound) -> GapTest:
    return detect(person.recording, DiagnosisSettings(fast=True, fmax=3.0))


def reversed_second(recording: Recording, stimulus: int, angles: int) -> Recording:
    """The recording whose second trial has its stimulus or its angles times -1."""
    first, second = recording.trials
    turned = replace(second, stimulus=stimulus * second.stimulus, theta=angles * second.theta, amplitude=None)
    return replace(recording, trials=(first, turned))


def readings_of(recording: Recording, accept: frozenset[str] = frozenset()) -> tuple[list[Mislabelled], float]:
    """Readings up to 3 Hz, and the log evidence for the recording as labelled."""
    lines = measure(recording, fmax=3.0)
    fit = base_fit(lines, recording.base_model(), 0)
    far = dict.fromkeys((c for c in READINGS if "thousand" in c or "_g_" in c or c[:3] in ("deg", "rad")), -50.0)
    return mislabelled(lines, fit.best, fit.minima, Labels(far, True, accept)), fit.best.log_evidence


@pytest.mark.parametrize(
    "name",
    [
        "stimulus / 2",
        "theta2 50 ms late",
        "second trial's angles 50 ms late",
        "segments exchanged in the body file",
        "theta1 low-passed at 3 Hz, zero phase",
        "theta2 20 ms late",
        "both angles 50 ms early",
        "second trial's angles low-passed at 3 Hz, causal",
    ],
)
def test_what_the_nominal_model_cannot_tell_is_the_best_reading(person: Sound, name: str) -> None:
    found, plain = readings_of(BY_NAME[name].change(person))
    assert found[0].hypothesis.effects[0] in BY_NAME[name].codes
    assert found[0].hypothesis.log_evidence + found[0].log_weight > plain + 10
    # Below 3 Hz a filter of fourth order does little more than delay.
    rivals = [m.hypothesis for m in found[1:] if "filtered" not in m.hypothesis.effects[0]]
    assert all(found[0].hypothesis.log_evidence > h.log_evidence + 3 for h in rivals)


@pytest.mark.parametrize("seed", [2, 6])
def test_no_reading_explains_a_sound_recording_better_than_its_labels(seed: int) -> None:
    found, plain = readings_of(sound(seed).recording)
    assert found
    assert all(m.hypothesis.log_evidence + m.log_weight < plain for m in found)


def test_a_code_that_the_user_accepts_is_not_tried(person: Sound) -> None:
    found, _ = readings_of(BY_NAME["stimulus / 2"].change(person), frozenset({"double"}))
    assert "double" not in {e for m in found for e in m.hypothesis.effects}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("noise without a response", "no response to the stimulus beyond noise"),
        ("clock of the angles 1 % fast", "their clock is 0.98 % faster than that of the stimulus"),
        ("theta1 / 9.81", "theta1: seems to be 9.81 times too small .* accept 'over_g_theta1'"),
        ("stimulus x 1000", "stimulus: reaches"),
        ("integral of theta2", "theta2: seems to be an integral over time"),
        ("theta1 in the frame of the trunk", "theta1: seems to be the angle of the upper body .* accept 'trunk_frame'"),
        ("second trial's angles exchanged", "trial 2: theta1, theta2: seems to be exchanged .* accept 'swapped'"),
    ],
)
def test_a_refusal_gives_the_right_reason(person: Sound, name: str, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        checked_recording(BY_NAME[name].change(person))


@pytest.mark.parametrize("seed", [3, 6])
def test_the_clock_of_one_trial_is_refused_for_that_trial(seed: int) -> None:
    words = r"trial 2: theta1, theta2: answer 0\.4\d s later .* their clock is 1(\.1)? % faster"
    with pytest.raises(RecordingError, match=words):
        check(BY_NAME["clock of the second trial's angles 1 % fast"].change(sound(seed)))
    check(sound(seed).recording)


@pytest.mark.parametrize("turned", [(-1, 1), (1, -1)])  # of the stimulus, of both angles
def test_a_mirrored_trial_that_cancels_the_other_is_refused_as_mirrored(turned: tuple[int, int]) -> None:
    recording = reversed_second(sound(0).recording, *turned)
    with pytest.raises(RecordingError, match=r"trial 2: stimulus or theta1, theta2: .* opposite sign .* cancel"):
        checked_recording(recording)


def test_a_protocol_may_reverse_the_stimulus_of_a_trial() -> None:
    recording = sound(0).recording
    plain, turned = (checked_recording(r).lines for r in (recording, reversed_second(recording, -1, -1)))
    np.testing.assert_allclose(turned.y, plain.y, rtol=1e-9)
    np.testing.assert_allclose(turned.noise.C, plain.noise.C, rtol=1e-6)


def test_low_passed_angles_are_not_refused_as_integrals() -> None:
    it = sound(6)  # before filters were among the labels' alternatives, its first trial was refused
    checked_recording(BY_NAME["both angles low-passed at 3 Hz, causal"].change(it))


def test_a_digital_filter_does_at_a_line_what_an_analogue_one_does_at_its_frequency(person: Sound) -> None:
    lines = measure(person.recording, fmax=8.0)
    b, a = butter(2, 3.0, fs=RATE_HZ)
    digital = freqz(b, a, lines.f, fs=RATE_HZ)[1]
    warped = Labels({}, True, rate_hz=RATE_HZ).digital(lines)
    corner = RATE_HZ / np.pi * np.tan(np.pi * 3.0 / RATE_HZ)
    np.testing.assert_allclose(butterworth(1j * warped / corner, 2), digital, rtol=1e-9)
    np.testing.assert_array_equal(Labels({}, True).digital(lines), lines.f)


def test_a_mislabelled_recording_says_what_to_check_and_its_json_conforms(person: Sound) -> None:
    d = diagnose(BY_NAME["second trial's stimulus x 2"].change(person), FAST)
    assert d.causes[0].effects == ("half_trial_2",)
    assert d.closed is None
    assert d.added is None
    assert d.place["recording"] > 0.99
    said = d.verdict()
    assert "a mislabelled recording, half_trial_2 (> 99 %)" in said
    assert "Trial 2: theta1, theta2: seems to be 2 times too small. Check the gain of the stimulus" in said
    assert "Location: recording (> 99 %)." in said
    assert "The active gains change" not in said
    plain = json.loads(json.dumps(d.to_dict(), allow_nan=False))
    schema.validate("diagnosis", plain, "diagnosis")
    assert plain["causes"][0]["advice"] in said
    assert "half_trial_2" in text(d)
    answer = from_diagnosis(plain)  # a challenge has no such cause
    check_answer({"name": "case", "seconds": 1.0, **answer}, "answers")
    assert answer["unknown_probability"] > 0.99
    assert answer["credible_set"] == ["unknown"]


def test_loose_fits_keep_the_right_reading_and_drop_those_far_from_any_body(person: Sound) -> None:
    recording = BY_NAME["stimulus / 2"].change(person)
    lines = measure(recording, fmax=3.0)
    fit = base_fit(lines, recording.base_model(), 0)
    search = Search(lines, fit.best, fit.minima, 0)
    T = np.array([search.only(READINGS[code].at(lines.f), None) for code in ("double", "half", "swapped")])
    assert search.promising(T).tolist() == [True, False, False]


def test_a_reading_of_all_trials_corrects_the_responses_and_leaves_the_agreement_of_the_trials(
    person: Sound, tested: GapTest
) -> None:
    lines = measure(person.recording, fmax=3.0)
    search = Search(lines, tested.fit.best, tested.fit.minima, 0)
    T = READINGS["space_angle"].at(lines.f)
    assert search.gain(search.only(T, None)) == pytest.approx(0.0, abs=1e-6)
    made = search._trials.corrected(search.only(T, None))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", T, made.y), lines.y)
    np.testing.assert_allclose(made.mix, T)
    whole = Data.of(lines)
    r = np.einsum("nij,nj->ni", T, np.ones_like(lines.y))
    given = np.einsum("nij,nj->ni", whole.weight, r)
    corrected = np.einsum("nij,nj->ni", made.weight, np.ones_like(lines.y))
    np.testing.assert_allclose((np.abs(given) ** 2).sum(axis=1), (np.abs(corrected) ** 2).sum(axis=1))


def test_segments_exchanged_twice_are_those_of_the_body() -> None:
    parts = segments(1.7, 70.0, None, None)
    names = {"m1": "m2", "h1": "h2", "I1": "I2", "m2": "m1", "h2": "h1", "I2": "I1"}
    wrong = Body.from_segments(**{names.get(k, k): v for k, v in parts.items()})
    for kind in ("ankle_torque", "platform_translation"):
        right = exchanged_segments(two_segment(wrong, kind), *gyrations()[0])
        expected = two_segment(Body.from_segments(**parts), kind)
        for name in ("J1", "J2", "C1", "C2", "A1", "A2"):
            assert getattr(body_of(right), name) == pytest.approx(getattr(body_of(expected), name))
        forces = [sorted((t.row, t.coefficient) for t in m.terms if t.sense == "stimulus") for m in (right, expected)]
        for (row, given), (other, wanted) in zip(*forces, strict=True):
            assert (row, given) == (other, pytest.approx(wanted))


def test_an_estimate_on_a_bound_or_beyond_a_body_is_no_explanation(tested: GapTest) -> None:
    base = tested.fit.best

    def loose(mass: float, frequency: float, se: float = 0.5) -> Hypothesis:
        model = apply(base.model, "loose_head")
        fitted = replace(base, model=model, theta=np.array([*base.theta, mass, frequency]))
        return Hypothesis(("loose_head",), 0.0, fitted, (SizeEstimate("m_loose", mass, se, mass, mass, "kg"),))

    assert possible(loose(5.0, 2.0), base)
    assert not possible(loose(15.0, 2.0), base)  # on the bound of the mass
    assert not possible(loose(5.0, 0.8), base)  # on the bound of the frequency
    assert not possible(loose(14.0, 2.0), base)  # no head
    assert possible(loose(14.0, 2.0, se=3.0), base)  # not certainly
    assert possible(Hypothesis((), 0.0, base), base)


def test_the_table_counts_every_answer(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    example = module("mislabelled")
    monkeypatch.setattr("sys.argv", ["mislabelled.py", "--only", "mirrored", "--recordings", "1"])
    example.main()
    shown = capsys.readouterr().out
    for name in ("both angles mirrored", "theta1 mirrored", "second trial's theta2 mirrored"):
        assert name in shown
    assert re.search(r"refused, right words: 100\.0 % .* of 6", shown)
    assert re.search(r"physiological: 0\.0 % .* of 6", shown)
    assert re.search(r"outside the library: 0\.0 % .* of 6", shown)
