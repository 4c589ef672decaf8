"""The challenge: hashed, the key apart, resumable, never a hole; what makes cases and what answers do not meet."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcstudy_challenge import files
from mcstudy_challenge.answer import answer, from_diagnosis
from mcstudy_challenge.answer import answered as answered_already
from mcstudy_challenge.cases import list_cases
from mcstudy_challenge.challenge_file import read_challenge, resolve
from mcstudy_challenge.design import ChallengeFile
from mcstudy_challenge.make import make
from mcstudy_challenge.scores.score import exit_code, score_files
from mcstudy_challenge.scores.table import score_text

from mcstudy import program
from mcstudy.cli import main
from mcstudy.errors import DesignError, InputError, StoreError, StudyChangedError
from mcstudy.exits import Exit
from mcstudy.files import json_files
from mcstudy.files.durable import tree_digest
from mcstudy.recordings.io import read_recording
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.fan_out import _one as one_item
from mcstudy.scheduler.fan_out import fan_out

ONE = ClusterOptions(workers=1)
PIPELINES = Path(__file__).parents[2] / "pipelines"

RAW: dict[str, Any] = {
    "challenge": {"name": "tiny", "seed": 3, "cases": 4},
    "mix": {"none": 0.25, "known": 0.25, "outsider": 0.25, "pair": 0.25, "shifted": 0.0},
    "sizes": {"effects": ["stimulus_gain", "head_mode"], "outsiders": ["sensor_crosstalk", "leg_wobble"]},
    "protocol": {"amplitudes": [5.0], "cycles": 3},
    "variant": {"white": {"cases": 1, "noise": {"colour": 0.0}}},
}


HEAD = '[challenge]\nname = "c"\nseed = 1\ncases = 3\n'


@pytest.fixture(scope="module")
def tiny() -> ChallengeFile:
    return resolve(RAW)


@pytest.fixture(scope="module")
def made(tiny: ChallengeFile, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("challenge")
    data, key = folder / "data", folder / "key.json"
    make(tiny, data, key, ONE)
    return data, key


def nothing_found(_: object) -> dict[str, Any]:
    return {
        "detected": False,
        "p_value": 0.5,
        "causes": [],
        "none_probability": 1.0,
        "unknown_probability": 0.0,
        "credible_set": ["none"],
        "closed": None,
    }


@pytest.fixture(scope="module")
def answered(made: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> str:
    """Answers to the data, as text."""
    out = tmp_path_factory.mktemp("answered") / "a.json"
    answer(made[0], out, nothing_found, "stub", ONE)
    return out.read_text()


@pytest.mark.parametrize("file", sorted(PIPELINES.glob("gap_challenge*.toml")), ids=lambda p: p.name)
def test_shipped_files_are_valid(file: Path) -> None:
    assert read_challenge(file).total >= 40


def test_the_benchmark_has_the_stated_mix() -> None:
    file = read_challenge(PIPELINES / "gap_challenge.toml")
    kinds = Counter(c.kind for c in list_cases(file))
    assert kinds == {"none": 500, "known": 900, "outsider": 300, "pair": 200, "shifted": 100}


def test_names_of_cases_do_not_tell_their_kind() -> None:
    cases = list_cases(read_challenge(PIPELINES / "gap_challenge.toml"))
    first = Counter(c.kind for c in cases[:1000])
    assert 200 < first["none"] < 300
    assert len({c.name for c in cases}) == len(cases)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mix": {"none": 0.5}}, "mix: expected shares that sum to 1"),
        ({"sizes": {"strata": [{"share": 1.0, "low": 5.0, "high": 2.0}]}}, "expected low <= high"),
        ({"protocol": {"cycles": 2}}, "protocol.*cycles"),
        ({"speed": {}}, "speed: unknown key"),
        ({"variant": {"main": {}}}, "variant.main"),
        ({"variant": {"a": {}}}, "variant.a.cases"),
        ({"challenge": {"name": "x", "seed": 1}}, "challenge.cases: missing"),
        ({"challenge": {"name": "x", "seed": 1, "cases": 0}}, "challenge.cases: expected at least 1, got 0"),
        (
            {"protocol": {"amplitude": [5.0]}},
            "protocol.amplitude: unknown key, expected one of amplitudes, cycles, fmax",
        ),
        ({"protocol": {"fmax": 1e6}}, "protocol.fmax: expected at most 8 Hz, the last frequency, got 1000000.0"),
        ({"protocol": {"fmax": 1e-6}}, "protocol.fmax: expected at least 0.02287 Hz, the first frequency, got 1e-06"),
        ({"protocol": {"fmax": 0.03}}, "protocol.fmax: expected at least 3 frequencies for 12 parameters"),
        ({"protocol": {"amplitudes": [1e300]}}, "protocol.amplitudes.0: expected at most 1000, got 1e\\+300"),
        ({"protocol": {"amplitudes": [1e-300]}}, "protocol.amplitudes.0: expected at least 0.001, got 1e-300"),
        ({"protocol": {"amplitudes": [5.0] * 100, "cycles": 1000}}, "protocol.cycles: expected a recording of at most"),
        ({"noise": {"level": 1e300}}, "noise.level: expected at most 1000000, got 1e\\+300"),
        ({"noise": {"psd": [1e300, 1.0]}}, "noise.psd.0: expected at most 1000"),
        ({"noise": {"corner_hz": 1e-300}}, "noise.corner_hz: expected at least 0.001"),
        ({"sizes": {"strata": []}}, "sizes.strata: expected a list with at least 1 item"),
        (
            {"sizes": {"strata": [{"share": 1.0, "low": 1.0, "high": 1e300}]}},
            "sizes.strata.0.high: expected at most 1000",
        ),
        ({"variant": {"a": {"cases": 1, "noise": 3}}}, "variant.a.noise: expected a table, got 3"),
        (
            {"variant": {"a": {"cases": 1, "protocol": {"fmax": 99.0}}}},
            "variant.a.protocol.fmax: expected at most 8 Hz",
        ),
    ],
)
def test_a_bad_file_is_told_in_one_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DesignError, match=message) as caught:
        resolve(RAW | change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"x = " + b"[" * 5000,
        b"[challenge]\n" + b"a." * 100_000 + b"b = 1",
        HEAD.encode() + b"[noise]\nlevel = " + b"9" * 5000,
        HEAD.replace("seed = 1", "seed = 0x" + "f" * 5000).encode(),
        HEAD.encode() + b"[body]\nspread = " + b"[" * 200 + b"]" * 200,
        b"\xff",
        b" " * 2_000_000,
    ],
    ids=["deep", "dotted", "digits", "hex", "nested", "bytes", "long"],
)
def test_what_is_no_challenge_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(DesignError, match=r"^[^\n]+$") as caught:
        read_challenge(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert len(str(caught.value)) < 400


def test_recordings_do_not_tell_their_cause(made: tuple[Path, Path]) -> None:
    data, key = made
    words = {"stimulus_gain", "head_mode", "crosstalk", "wobble", "outsider", "known", "pair"}
    for path in data.glob("*.nc"):
        recording = read_recording(path)
        assert recording.name == path.stem
        assert not any(w in recording.provenance for w in words)
        assert not any(w.encode() in path.read_bytes() for w in words)
    manifest = (data / files.MANIFEST).read_text()
    assert not any(w in manifest for w in words - {"known"})
    assert json.loads(manifest)["key_sha256"] == json_files.digest(key)


def test_the_key_describes_every_case(made: tuple[Path, Path]) -> None:
    key = json_files.read_json(made[1], "challenge_key")
    assert Counter((c["series"], c["kind"]) for c in key["cases"]) == {
        ("main", "none"): 1,
        ("main", "known"): 1,
        ("main", "outsider"): 1,
        ("main", "pair"): 1,
        ("white", "none"): 1,
    }
    for case in key["cases"]:
        if case["kind"] == "known":
            assert case["closable"][case["effects"][0]["effect"]] > 0.999
        if case["kind"] == "pair":
            assert case["residual_delta"] <= case["delta"]
        if case["kind"] == "outsider":
            assert not case["effects"]
            assert case["delta"] > 0.5


def test_making_again_changes_nothing_and_a_killed_run_resumes(
    tiny: ChallengeFile, made: tuple[Path, Path], tmp_path: Path
) -> None:
    data, key = made
    before = tree_digest(data)
    make(tiny, data, key, ONE)
    assert tree_digest(data) == before
    # A run that was killed after two cases has their recordings and their parts of the key.
    other, other_key = tmp_path / "data", tmp_path / "key.json"
    truth = json.loads(key.read_text())
    other.mkdir()
    files.partial_folder(other_key).mkdir()
    for case in truth["cases"][:4]:
        name = f"{case['name']}.nc"
        (other / name).write_bytes((data / name).read_bytes())
        made_by = {"fingerprint": tiny.fingerprint, "program": program.maker("mcstudy_challenge")}
        part = made_by | {"sha256": json_files.digest(other / name), "truth": case}
        (files.partial_folder(other_key) / f"{case['name']}.json").write_text(json.dumps(part))
    (other / "case5.nc.abc.partial").write_bytes(b"torn")
    make(tiny, other, other_key, ONE)
    assert tree_digest(other) == before
    assert json_files.digest(other_key) == json_files.digest(key)


def test_recordings_of_another_program_are_not_taken_for_those_of_this(
    tiny: ChallengeFile, made: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert json.loads((made[0] / files.MANIFEST).read_text())["program"] == program.maker("mcstudy_challenge")
    monkeypatch.setattr(program, "source", lambda *_: "0" * 64)
    with pytest.raises(
        StudyChangedError, match=r"^[^\n]*made by another program: source [0-9a-f]{12}, here 0000[^\n]*$"
    ):
        make(tiny, *made, ONE)


def test_another_challenge_is_refused(made: tuple[Path, Path]) -> None:
    with pytest.raises(StudyChangedError, match="another challenge file"):
        make(resolve(RAW | {"challenge": {"name": "tiny", "seed": 4, "cases": 4}}), *made, ONE)


def test_the_key_may_not_lie_with_the_data(tiny: ChallengeFile, made: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="outside the data folder"):
        make(tiny, tmp_path / "d", tmp_path / "d" / "key.json", ONE)
    data, key = made
    leak = data / "notes.json"
    leak.write_bytes(key.read_bytes())
    try:
        with pytest.raises(StoreError, match="answer key found in the data folder"):
            answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
        leak.write_text("{}")
        with pytest.raises(StoreError, match="not in the manifest"):
            answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
    finally:
        leak.unlink()


def test_answering_loads_nothing_that_makes_cases() -> None:
    script = (
        "import sys, mcstudy_challenge.answer\n"
        "made = {m for m in sys.modules if m.startswith('mcstudy_challenge') and m.split('.')[-1] in "
        "('out_of_library', 'forms', 'form_steps', 'other_forms', 'foreign_recordings', 'foreign_body', "
        "'foreign_effects', 'stability_margin', 'geometry', 'truth', 'cases', 'withheld_causes', 'make', 'score')}\n"
        "assert not made, made\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_a_failure_is_an_answer_and_is_scored_as_wrong(made: tuple[Path, Path], tmp_path: Path) -> None:
    data, key = made
    truth = {c["name"]: c for c in json.loads(key.read_text())["cases"]}
    bad = next(n for n, c in truth.items() if c["kind"] == "none" and c["series"] == "main")

    def diagnose(recording: Any) -> dict[str, Any]:
        if recording.name == bad:
            raise ValueError("no convergence\nat all")
        return nothing_found(recording)

    answer(data, tmp_path / "a.json", diagnose, "stub", ONE)
    given = json_files.read_json(tmp_path / "a.json", "challenge_answers")
    assert [a["name"] for a in given["answers"]] == sorted(truth)
    assert {a["name"]: a.get("error") for a in given["answers"]}[bad] == "ValueError: no convergence at all"
    score = score_files(data, key, tmp_path / "a.json")
    assert score["targets"][0]["value"] == 1.0
    assert exit_code(score) == Exit.MISSED
    assert bad in score_text(score)


def test_a_malformed_diagnosis_is_an_error_too(made: tuple[Path, Path], tmp_path: Path) -> None:
    data, _ = made
    answer(data, tmp_path / "a.json", lambda _: nothing_found(_) | {"p_value": math.nan}, "stub", ONE)
    given = json_files.read_json(tmp_path / "a.json", "challenge_answers")
    assert all("error" in a for a in given["answers"])


OTHER_ANSWERS = {
    '{"method": "other"}': "answers of the method 'other', expected 'stub'",
    '{"manifest_sha256": "' + 64 * "0" + '"}': "answers to other data",
    '{"program": null}': "does not say by which program it was made",
    '{"program": {"source": "' + 64 * "0" + '", "versions": {}}}': "made by another program: source 000000000000, here",
}
"""Changes of answers, as JSON, and why they are not taken for those of this method and program."""


def test_answers_resume_and_do_not_mix_methods(made: tuple[Path, Path], tmp_path: Path) -> None:
    data, _ = made
    sha = json_files.digest(data / files.MANIFEST)
    parts = files.partial_folder(tmp_path / "a.json")
    parts.mkdir()
    done = {"name": "case1", "seconds": 0.0, **from_diagnosis(nothing_found(None))}
    part = {"manifest_sha256": sha, "method": "stub", "program": program.maker("mcstudy_challenge"), "answer": done}
    (parts / "case1.json").write_text(json.dumps(part))
    (parts / "case2.json").write_text("{torn")

    def diagnose(recording: Any) -> dict[str, Any]:
        (tmp_path / f"asked_{recording.name}").touch()
        return nothing_found(recording)

    answer(data, tmp_path / "a.json", diagnose, "stub", ONE)
    assert sorted(p.name for p in tmp_path.glob("asked_*")) == [f"asked_case{k}" for k in (2, 3, 4, 5)]
    assert not parts.exists()
    parts.mkdir()
    for change, why in OTHER_ANSWERS.items():
        (parts / "case1.json").write_text(json.dumps(part | json.loads(change)))
        with pytest.raises(StudyChangedError, match=why):
            answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)


@pytest.mark.parametrize("change", OTHER_ANSWERS)
def test_whole_answers_of_another_method_or_program_are_not_taken_for_these(
    made: tuple[Path, Path], tmp_path: Path, change: str
) -> None:
    data, key = made
    out = tmp_path / "a.json"
    assert not answered_already(data, out, "stub")
    answer(data, out, nothing_found, "stub", ONE)
    assert answered_already(data, out, "stub")
    given = json.loads(out.read_text())
    assert given["program"] == program.maker("mcstudy_challenge")
    out.write_text(json.dumps({k: v for k, v in (given | json.loads(change)).items() if v is not None}))
    with pytest.raises(StudyChangedError, match=f"^[^\n]*{OTHER_ANSWERS[change]}[^\n]*$"):
        answered_already(data, out, "stub")
    if "manifest_sha256" not in change:
        assert score_files(data, key, out)["method"] == (given | json.loads(change))["method"]


def test_a_command_whose_file_now_asks_for_another_method_prints_no_score_of_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcstudy_challenge.answer.METHODS", {"fast": nothing_found, "detect": nothing_found})
    file = tmp_path / "c.toml"
    for method, code in (("fast", Exit.DONE), ("fast", Exit.DONE), ("detect", Exit.BAD_INPUT)):
        text = f'[challenge]\nname = "c"\nseed = 3\ncases = 1\n[answer]\nmethod = "{method}"\n'
        file.write_text(text + "[mix]\nnone = 1\nknown = 0\noutsider = 0\npair = 0\nshifted = 0\n")
        assert main(["gap", "challenge", "run", str(file), "-o", str(tmp_path / "out"), "--workers", "1"]) == code
        printed = capsys.readouterr()
        assert bool(printed.out) == (code == Exit.DONE)
    assert "answers of the method 'fast', expected 'detect'" in printed.err
    with monkeypatch.context() as patch:
        patch.setattr(program, "source", lambda *_: "0" * 64)
        assert main(["gap", "challenge", "run", str(file), "-o", str(tmp_path / "out")]) == Exit.BAD_INPUT
    assert (
        f"made by another program: source {program.maker('mcstudy_challenge')['source'][:12]}, here 0000"
        in capsys.readouterr().err
    )


def test_a_worker_of_another_program_gives_no_result() -> None:
    own = program.maker()
    assert one_item("another process", own, "fan", str, 1) == "1"
    with pytest.raises(InputError, match="made by another program: source"):  # the source of the wing counts as well
        one_item("another process", own, "fan", files.partial_folder, 1)
    other = own | {"versions": {**own["versions"], "numpy": "0.1"}}
    with pytest.raises(InputError, match=f"made by another program: numpy {np.__version__}, here 0.1"):
        one_item("another process", other, "fan", str, 1)


def test_a_changed_key_and_foreign_answers_are_refused(made: tuple[Path, Path], tmp_path: Path) -> None:
    data, key = made
    answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
    forged = tmp_path / "key.json"
    forged.write_text(key.read_text().replace('"known"', '"none"'))
    with pytest.raises(StoreError, match="not the key"):
        score_files(data, forged, tmp_path / "a.json")
    foreign = json.loads((tmp_path / "a.json").read_text()) | {"manifest_sha256": "0" * 64}
    (tmp_path / "b.json").write_text(json.dumps(foreign))
    with pytest.raises(StoreError, match="answers to other data"):
        score_files(data, key, tmp_path / "b.json")
    short = json.loads((tmp_path / "a.json").read_text())
    short["answers"].pop()
    (tmp_path / "c.json").write_text(json.dumps(short))
    with pytest.raises(StoreError, match="has no answer"):
        score_files(data, key, tmp_path / "c.json")


def test_the_command_makes_and_scores(
    made: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, key = made
    answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
    words = ["gap", "challenge", "score", str(data), "--key", str(key), "--answers", str(tmp_path / "a.json")]
    assert main([*words, "--json", "-o", str(tmp_path / "s.json")]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "s.json").read_text())
    assert main(words) == 0
    assert "false alarms" in capsys.readouterr().out
    assert main([*words, "--json", "--share-none", "0.2"]) == 0
    assert [s["nulls"] for s in json.loads(capsys.readouterr().out)["other_shares"]] == [0.2]
    assert main([*words, "--share-none", "0.2", "1"]) == 2
    assert "--share-none: expected shares above 0 and below 1, got 0.2 1.0" in capsys.readouterr().err
    assert main(["gap", "challenge", "make", "nowhere.toml", "--data", "d", "--key", "k"]) == 2
    assert "nowhere.toml: expected a challenge file (.toml) or the name of a challenge" in capsys.readouterr().err


def test_the_command_takes_certificates_and_refuses_what_makes_no_scheduler(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c.toml").write_text('[challenge]\nname = "c"\nseed = 1\ncases = 3\n[protocol]\ncycles = 3\n')
    words = ["gap", "challenge", "run", str(tmp_path / "c.toml"), "-o", str(tmp_path / "out")]
    assert main([*words, "--scheduler", "tls://127.0.0.1:1", "--tls-ca", str(tmp_path / "no.pem")]) == 2
    assert "--tls-ca: expected a readable PEM file" in capsys.readouterr().err
    assert main([*words, "--scheduler", "tcp://192.0.2.1:8786"]) == 2
    assert "expected tls:// for 192.0.2.1" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*words, "--workers", "0"])
    assert "expected a whole number from 1" in capsys.readouterr().err


def test_an_unknown_effect_in_the_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"sizes\.effects: unknown effect 'gravity'"):
        resolve(RAW | {"sizes": {"effects": ["gravity"]}, "variant": {}})
    file = tmp_path / "ghost.toml"
    file.write_text(
        HEAD + "[mix]\nnone = 0.5\nknown = 0.0\noutsider = 0.5\npair = 0.0\nshifted = 0.0\n"
        "[sizes]\noutsiders = ['leg_wobble', 'ghost']\n"
    )
    with pytest.raises(DesignError, match=r"ghost\.toml: sizes\.outsiders: expected one of hysteresis, .*got 'ghost'$"):
        read_challenge(file)


def test_effects_that_nobody_could_see_are_told_before_anything_is_made(tmp_path: Path) -> None:
    loud = RAW | {"noise": {"level": 1e6}, "variant": {}}
    for sizes, message in (
        ({}, "protocol: expected recordings in which at least 2 of the effects can reach a delta of 2, found 0"),
        ({"effects": ["head_mode"]}, "sizes.effects: head_mode stays below a delta of 2 within its bounds"),
    ):
        with pytest.raises(DesignError, match=message):
            make(resolve(loud | {"sizes": sizes}), tmp_path / "d", tmp_path / "k.json", ONE)
    with pytest.raises(DesignError, match=r"protocol: .*at least 2 of the effects .*found 1"):
        make(resolve(RAW | {"sizes": {"effects": ["head_mode"]}}), tmp_path / "d", tmp_path / "k.json", ONE)
    assert not list(tmp_path.iterdir())


def test_a_series_may_hold_nonlinear_effects_alone(tmp_path: Path) -> None:
    raw = RAW | {
        "challenge": {"name": "rules", "seed": 3, "cases": 2},
        "mix": {"none": 0.5, "known": 0.5, "outsider": 0.0, "pair": 0.0, "shifted": 0.0},
        "sizes": {"effects": ["gain_drift"], "strata": [{"share": 1.0, "low": 4.0, "high": 15.0}]},
        "variant": {},
    }
    make(resolve(raw), tmp_path / "d", tmp_path / "k.json", ONE)
    cases = {c["kind"]: c for c in json_files.read_json(tmp_path / "k.json", "challenge_key")["cases"]}
    assert cases["known"]["closable"] == {"gain_drift": 1.0}
    assert cases["none"]["ceiling"] == {}


def test_cases_do_not_depend_on_workers_or_order(tiny: ChallengeFile, made: tuple[Path, Path], tmp_path: Path) -> None:
    make(tiny, tmp_path / "data", tmp_path / "key.json", ClusterOptions(workers=2))
    assert tree_digest(tmp_path / "data") == tree_digest(made[0])
    assert np.array_equal(
        read_recording(tmp_path / "data" / "case1.nc").trials[0].theta,
        read_recording(made[0] / "case1.nc").trials[0].theta,
    )


def test_a_stopped_run_says_so_and_keeps_what_is_done(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys\n"
        "from mcstudy.cli import main\n"
        "from mcstudy_challenge import make\n"
        "whole = make.make_case\n"
        "def stop(file, case):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    return whole(file, case)\n"
        "make.make_case = stop\n"
        f"sys.exit(main(['gap', 'challenge', 'make', {str(tmp_path / 'c.toml')!r}, '--data', {str(tmp_path / 'd')!r}, "
        f"'--key', {str(tmp_path / 'k.json')!r}, '--workers', '1']))\n"
    )
    (tmp_path / "c.toml").write_text('[challenge]\nname = "c"\nseed = 1\ncases = 3\n[protocol]\ncycles = 3\n')
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 3
    assert "run the same command again to resume" in done.stderr
    assert not (tmp_path / "k.json").exists()


def test_no_thread_works_on_after_an_error(tmp_path: Path) -> None:
    """One case fails while another is being worked on: the error comes when that one has ended, and no third begins."""

    def work(item: int) -> None:
        (tmp_path / f"begun{item}").touch()
        if item:
            time.sleep(3.0)
            (tmp_path / f"ended{item}").touch()
        else:
            while not (tmp_path / "begun1").exists():
                time.sleep(0.01)
            raise StoreError("this case cannot be made")

    with pytest.raises(StoreError, match="this case cannot be made"):
        list(fan_out(work, range(12), ClusterOptions(workers=2), "here"))
    left = sorted(p.name for p in tmp_path.iterdir())
    assert {p.removeprefix("begun") for p in left if p.startswith("begun")} - {"0"} == {
        p.removeprefix("ended") for p in left if p.startswith("ended")
    }
    time.sleep(1.5)
    assert sorted(p.name for p in tmp_path.iterdir()) == left


def test_whoever_stops_taking_results_waits_for_those_on_the_way(tmp_path: Path) -> None:
    def work(item: int) -> int:
        (tmp_path / f"begun{item}").touch()
        time.sleep(0.5 * item)
        (tmp_path / f"ended{item}").touch()
        return item

    results = fan_out(work, range(6), ClusterOptions(workers=2), "here")
    assert next(results) == (0, 0)
    results.close()
    begun, ended = (len(list(tmp_path.glob(f"{word}*"))) for word in ("begun", "ended"))
    assert begun == ended < 6


@pytest.mark.parametrize(
    "text",
    ["5", "[]", "{}", "null", "{torn", '{"answer": 5}', "[" * 5000, '{"answer": {"name": "case1", "seconds": 1}}'],
)
def test_a_part_that_is_none_is_done_again(made: tuple[Path, Path], tmp_path: Path, text: str) -> None:
    data, _ = made
    parts = files.partial_folder(tmp_path / "a.json")
    parts.mkdir()
    (parts / "case1.json").write_text(text)
    (parts / "notes").mkdir()
    answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
    assert len(json_files.read_json(tmp_path / "a.json", "challenge_answers")["answers"]) == 5
    assert not (parts / "case1.json").exists()


def test_a_part_that_cannot_be_scored_is_done_again(made: tuple[Path, Path], tmp_path: Path) -> None:
    data, _ = made
    done = {"name": "case1", "seconds": 0.0, **from_diagnosis(nothing_found(None))}
    header = {
        "manifest_sha256": json_files.digest(data / files.MANIFEST),
        "method": "stub",
        "program": program.maker("mcstudy_challenge"),
    }
    parts = files.partial_folder(tmp_path / "a.json")
    parts.mkdir()
    unsound = header | {"answer": done | {"unknown_probability": 0.8}}
    (parts / "case1.json").write_text(json.dumps(unsound))
    (parts / "case2.json").write_text(json.dumps(header | {"answer": done}))  # the answer to another case
    answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
    given = json_files.read_json(tmp_path / "a.json", "challenge_answers")["answers"]
    assert [a["unknown_probability"] for a in given] == [0.0] * 5
    assert [a["name"] for a in given] == [f"case{k}" for k in range(1, 6)]


def test_a_recording_that_was_changed_is_not_answered(made: tuple[Path, Path], tmp_path: Path) -> None:
    data = Path(shutil.copytree(made[0], tmp_path / "data"))
    (data / "case2.nc").write_bytes((data / "case3.nc").read_bytes())
    with pytest.raises(StoreError, match=r"case2\.nc: expected the recording whose SHA-256 the manifest has"):
        answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)


def test_a_recording_that_was_changed_is_made_again(
    tiny: ChallengeFile, made: tuple[Path, Path], tmp_path: Path
) -> None:
    data, key = tmp_path / "data", tmp_path / "key.json"
    data.mkdir()
    files.partial_folder(key).mkdir()
    for case in json.loads(made[1].read_text())["cases"]:
        recording = made[0] / f"{case['name']}.nc"
        (data / recording.name).write_bytes(recording.read_bytes())
        part = {"fingerprint": tiny.fingerprint, "sha256": json_files.digest(recording), "truth": case}
        (files.partial_folder(key) / f"{case['name']}.json").write_text(json.dumps(part))
    (data / "case2.nc").write_bytes(b"torn")
    make(tiny, data, key, ONE)
    assert tree_digest(data) == tree_digest(made[0])


def forged(made: tuple[Path, Path], tmp_path: Path, change: Callable[[dict[str, Any]], None]) -> tuple[Path, Path]:
    """Data and a key that somebody changed, and whose digest they wrote into the manifest."""
    data, key = Path(shutil.copytree(made[0], tmp_path / "data")), tmp_path / "key.json"
    truth = json.loads(made[1].read_text())
    change(truth)
    key.write_text(json.dumps(truth))
    manifest = json.loads((data / files.MANIFEST).read_text())
    (data / files.MANIFEST).write_text(json.dumps(manifest | {"key_sha256": json_files.digest(key)}))
    return data, key


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda k: k.update(design={}), r"key\.json: design\.challenge: missing"),
        (lambda k: k["design"]["series"]["main"]["protocol"].update(fmax=1e6), r"design\.series\.main\.protocol\.fmax"),
        (lambda k: k["cases"].append(k["cases"][0]), "case1: name: expected every case once, found 2"),
        (lambda k: k["cases"].pop(), "cases: expected the 5 cases of the manifest"),
        (lambda k: k["cases"][0].update(series="other"), "case1: series: expected one of main, white, found 'other'"),
        (lambda k: k["cases"][0].update(effects=[{}] * 2), r"cases\.0\.effects\.0\.effect: missing"),
        (lambda k: [c.update(kind="known") for c in k["cases"]], "effects: expected 1 for kind known, found"),
        (lambda k: k["cases"][0].update(delta="large"), r"cases\.0\.delta: expected a number, found 'large'"),
    ],
)
def test_a_key_that_contradicts_itself_is_refused(
    made: tuple[Path, Path], tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    data, key = forged(made, tmp_path, change)
    answer(data, tmp_path / "a.json", nothing_found, "stub", ONE)
    with pytest.raises(StoreError, match=message) as caught:
        score_files(data, key, tmp_path / "a.json")
    assert str(caught.value).startswith(f"{key}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"p_value": 0.5', '"p_value": NaN', "expected JSON: expected finite numbers, found NaN"),
        ('"p_value": 0.5', '"p_value": 1e999', "expected JSON: expected finite numbers, found 1e999"),
        ('"p_value": 0.5', '"p_value": 0.5, "p_value": 0.1', "expected JSON: .* found 'p_value' twice"),
        (
            '"p_value": 0.5',
            f'"p_value": {"9" * 5000}',
            "expected whole numbers of at most 20 digits, found 5000 digits",
        ),
        ('"p_value": 0.5', '"p_value": 2', "case1: p_value: expected at most 1, found 2"),
        ('"p_value": 0.5', '"p_value": true', "case1: p_value: expected a number, found True"),
        ('"p_value": 0.5,', "", "case1: p_value: missing"),
        ('"none_probability": 1.0', '"none_probability": 0.9', "case1: credible_set: expected hypotheses with"),
        ('"none_probability": 1.0', f'"a": {"[" * 100}{"]" * 100}', "expected nesting of at most 64 levels"),
        ('"method": "stub"', '"method": "\\ud800"', "one half of a surrogate pair"),
        ('"method": "stub"', '"method": "stub", "author": "me"', "top level: expected only the keys .* found 'author'"),
        ('"name": "case2"', '"name": "case1"', "case1: name: expected one answer per case, found 2"),
        ('"name": "case2"', '"name": "case9"', "case9.*: name: expected a case of these data"),
    ],
)
def test_answers_from_anybody_are_refused_with_file_case_and_field(
    made: tuple[Path, Path],
    answered: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    data, key = made
    assert old in answered
    (tmp_path / "b.json").write_text(answered.replace(old, new, 1))
    words = ["gap", "challenge", "score", str(data), "--key", str(key), "--answers", str(tmp_path / "b.json")]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert re.search(f"^mcstudy: {tmp_path}/b.json: .*{message}", told)
    assert told.count("\n") == 1
    assert len(told) < 600


def test_a_stranger_s_text_does_not_steer_the_terminal(made: tuple[Path, Path], answered: str, tmp_path: Path) -> None:
    data, key = made
    given = json.loads(answered) | {"method": "\x1b[2Jbest\nof all"}
    given["answers"][0] = {"name": "case1", "seconds": 0.0, "error": "\x07" + "long " * 1000}
    (tmp_path / "b.json").write_text(json.dumps(given))
    page = score_text(score_files(data, key, tmp_path / "b.json"))
    assert "answered by \\x1b[2Jbest of all, " in page
    assert all(line.isprintable() and len(line) < 400 for line in page.splitlines())


@pytest.mark.parametrize("verb", ["make", "answer", "score"])
def test_folders_that_cannot_be_are_told_in_one_line(
    made: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "c.toml").write_text(HEAD + "[protocol]\ncycles = 3\n")
    here, data, key = str(tmp_path / "file" / "in"), str(made[0]), str(made[1])
    words = {
        "make": [str(tmp_path / "c.toml"), "--data", here, "--key", str(tmp_path / "k.json")],
        "answer": [data, "-o", here],
        "score": [data, "--key", key, "--answers", here],
    }[verb]
    assert main(["gap", "challenge", verb, *words]) == 2
    told = capsys.readouterr().err
    assert here.removesuffix("/in") in told
    assert told.count("\n") == 1
