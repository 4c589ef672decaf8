"""Kept diagnoses save time and change nothing: the same bytes are printed, and what is not sound is computed again."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mcstudy import program
from mcstudy.cli import kept_diagnosis as module
from mcstudy.cli import main
from mcstudy.cli.kept_diagnosis import MOST, VARIABLE, folder, kept_diagnosis
from mcstudy.errors import RecordingError
from mcstudy.exits import Exit
from mcstudy.gap import diagnose
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.document import document
from mcstudy.gap.settings import FAST
from mcstudy.recordings.io import read_recording, write_recording
from mcstudy.recordings.recording import Recording

pytestmark = pytest.mark.usefixtures("place")

OPTIONS = {"method": "fast", "seed": 0, "accept": []}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of kept diagnoses, which is not there yet."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "caches"))
    return tmp_path / "caches" / "diagnoses"


@pytest.fixture(scope="session")
def diagnosed(plain_recordings: list[Recording]) -> DiagnosisRecord:
    return diagnose.diagnose(plain_recordings[0], FAST)


class Computed:
    """Hands out one diagnosis and counts how often."""

    def __init__(self, diagnosis: DiagnosisRecord) -> None:
        self.diagnosis, self.times = diagnosis, 0

    def __call__(self) -> DiagnosisRecord:
        self.times += 1
        return self.diagnosis


@pytest.fixture
def computed(diagnosed: DiagnosisRecord) -> Computed:
    return Computed(diagnosed)


def test_a_second_look_prints_the_same_bytes_and_diagnoses_nothing(
    place: Path,
    plain_recordings: list[Recording],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, page = str(tmp_path / "body.nc"), tmp_path / "page.html"
    write_recording(plain_recordings[0], Path(file))
    looks = [["diagnose", file, "--fast"], ["diagnose", file, "--fast", "--json"], ["next", file, "--trials", "1"]]
    looks.append(["report", file, "--fast", "-o", str(page)])

    def printed() -> tuple[str, bytes]:
        assert [main(["gap", *words]) for words in looks] == [Exit.DONE] * len(looks)
        return capsys.readouterr().out, page.read_bytes()

    with monkeypatch.context() as nothing_kept:
        nothing_kept.setenv(VARIABLE, "")
        first = printed()
        assert not place.exists()
    assert printed() == first
    assert len(list(place.iterdir())) == 1
    for name in ("diagnose", "diagnose"):
        monkeypatch.setattr(diagnose, name, lambda *_, **__: pytest.fail("diagnosed again"))
    assert printed() == first


def test_a_diagnosis_comes_back_to_the_last_bit(plain_recordings: list[Recording], computed: Computed) -> None:
    found = [kept_diagnosis(plain_recordings[:1], OPTIONS, computed) for _ in range(2)]
    assert computed.times == 1
    assert found[1] is not found[0]
    assert document(found[1]) == document(found[0])
    assert np.array_equal(found[1].detection.z, found[0].detection.z)
    assert found[1].recording == found[0].recording == plain_recordings[0]


def test_the_signals_of_a_recording_are_not_kept(place: Path, plain_recordings: list[Recording]) -> None:
    for recordings in (plain_recordings[:1], plain_recordings[:2]):
        kept_diagnosis(recordings, OPTIONS, Computed(diagnose.diagnose(recordings, FAST)))
    files = [file.read_bytes() for file in place.iterdir()]
    signals = [signal for r in plain_recordings[:2] for t in r.trials for signal in (t.theta, t.stimulus)]
    assert len(files) == 2
    assert all(signal.ravel()[1000:1010].tobytes() not in file for signal in signals for file in files)


def test_a_diagnosis_of_signals_that_were_not_read_is_not_kept(
    place: Path, plain_recordings: list[Recording], computed: Computed
) -> None:
    one = plain_recordings[0]
    copied = replace(one, trials=tuple(replace(trial) for trial in one.trials))
    assert kept_diagnosis([copied], OPTIONS, computed) is computed.diagnosis
    assert not place.exists()


CHANGES: dict[str, Callable[[pytest.MonkeyPatch], object]] = {
    "the program": lambda patch: patch.setattr(program, "source", lambda *_: "0" * 64),
    "a library": lambda patch: patch.setattr(program, "versions", lambda names: dict.fromkeys(names, "2")),
    "threads": lambda patch: patch.setenv("OMP_NUM_THREADS", "7"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_diagnosis_by_another_program_is_not_taken(
    plain_recordings: list[Recording], computed: Computed, change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    CHANGES[change](monkeypatch)
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    assert computed.times == 2


def test_other_data_and_other_options_have_other_diagnoses(
    plain_recordings: list[Recording], computed: Computed
) -> None:
    one, two = plain_recordings[:2]
    theta = np.array(one.trials[0].theta)
    theta.flat[-1] = np.nextafter(theta.flat[-1], 1)
    edited = replace(one, trials=(replace(one.trials[0], theta=theta), *one.trials[1:]))
    asked = [[one], [two], [one, two], [two, one], [edited], [replace(one, name="other")]]
    for recordings in asked:
        kept_diagnosis(recordings, OPTIONS, computed)
    for options in (
        {"seed": 1},
        {"accept": ["units_theta1"]},
        {"method": "bootstrap"},
        {"fmax": 8.0},
        {"prior_none": 0.3},
    ):
        kept_diagnosis([one], OPTIONS | options, computed)
    assert computed.times == 11


def test_a_whole_diagnosis_answers_who_asks_for_the_cause_only_and_not_the_reverse(
    place: Path, plain_recordings: list[Recording], computed: Computed
) -> None:
    cause = OPTIONS | {"asked": "cause"}
    kept_diagnosis(plain_recordings[:1], cause, computed, also=[OPTIONS])
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    assert computed.times == 2
    shutil.rmtree(place)
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    kept_diagnosis(plain_recordings[:1], cause, computed, also=[OPTIONS])
    assert computed.times == 3


def _cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-1])


def _flipped(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize("damage", [_cut, _flipped], ids=["cut", "one bit"])
def test_a_damaged_file_is_computed_again_and_replaced(
    place: Path, plain_recordings: list[Recording], computed: Computed, damage: Callable[[Path], None]
) -> None:
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    (file,) = place.iterdir()
    sound = file.read_bytes()
    damage(file)
    assert kept_diagnosis(plain_recordings[:1], OPTIONS, computed) is computed.diagnosis
    assert file.read_bytes() == sound


def test_a_file_under_the_name_of_another_is_not_taken(
    place: Path, plain_recordings: list[Recording], computed: Computed
) -> None:
    for seed in (0, 1):
        kept_diagnosis(plain_recordings[:1], OPTIONS | {"seed": seed}, computed)
    first, second = sorted(place.iterdir())
    shutil.copyfile(first, second)
    for seed in (0, 1):
        kept_diagnosis(plain_recordings[:1], OPTIONS | {"seed": seed}, computed)
    assert computed.times == 3


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702], ids=oct)
def test_what_others_could_have_written_is_never_read(
    place: Path, plain_recordings: list[Recording], computed: Computed, mode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    place.chmod(mode)
    monkeypatch.setattr(module, "from_bytes", lambda *_: pytest.fail("read what others could have written"))
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    assert computed.times == 2


def test_a_folder_of_another_user_is_not_used(
    place: Path, plain_recordings: list[Recording], computed: Computed, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    monkeypatch.setattr(os, "getuid", lambda: place.stat().st_uid + 1)
    for seed in (0, 1):
        kept_diagnosis(plain_recordings[:1], OPTIONS | {"seed": seed}, computed)
    assert computed.times == 3
    assert len(list(place.iterdir())) == 1


def test_a_new_folder_is_for_this_user_alone(
    place: Path, plain_recordings: list[Recording], computed: Computed
) -> None:
    mask = os.umask(0)
    try:
        kept_diagnosis(plain_recordings[:1], OPTIONS, computed)
    finally:
        os.umask(mask)
    assert place.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_cannot_be_made_keeps_nothing(
    place: Path, plain_recordings: list[Recording], computed: Computed
) -> None:
    place.parent.write_bytes(b"")
    found = [kept_diagnosis(plain_recordings[:1], OPTIONS, computed) for _ in range(2)]
    assert found == [computed.diagnosis] * 2
    assert computed.times == 2


def test_errors_are_not_kept(place: Path, plain_recordings: list[Recording]) -> None:
    def fails() -> DiagnosisRecord:
        raise RecordingError("too short")

    for _ in range(2):
        with pytest.raises(RecordingError, match="too short"):
            kept_diagnosis(plain_recordings[:1], OPTIONS, fails)
    assert not place.exists()


def test_only_the_newest_are_kept(place: Path, plain_recordings: list[Recording], computed: Computed) -> None:
    for k in range(MOST + 2):
        kept_diagnosis(plain_recordings[:1], OPTIONS | {"seed": k}, computed)
        newest = max(place.iterdir(), key=lambda f: f.stat().st_mtime_ns)
        os.utime(newest, ns=(k, k))  # files written within one tick of the clock would be of the same age
    assert len(list(place.iterdir())) == MOST
    kept_diagnosis(plain_recordings[:1], OPTIONS | {"seed": MOST + 1}, computed)
    assert computed.times == MOST + 2


def test_every_process_gives_a_recording_the_same_name(
    plain_recordings: list[Recording], diagnosed: DiagnosisRecord, tmp_path: Path
) -> None:
    file = tmp_path / "body.nc"
    write_recording(plain_recordings[0], file)
    read = read_recording(file)
    kept_diagnosis([read], OPTIONS, Computed(replace(diagnosed, recording=read)))
    code = (
        "import sys; from pathlib import Path; from mcstudy.cli.kept_diagnosis import kept_diagnosis\n"
        "from mcstudy.recordings.io import read_recording\n"
        f"kept_diagnosis([read_recording(Path(sys.argv[1]))], {OPTIONS}, lambda: sys.exit('not found'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, file], env=os.environ | {"PYTHONHASHSEED": "7"}, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_folder_is_the_users_unless_another_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert folder() == tmp_path / ".cache" / "mcstudy" / "diagnoses"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    assert folder() == tmp_path / "x" / "mcstudy" / "diagnoses"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # which the specification of this variable ignores
    assert folder() == tmp_path / ".cache" / "mcstudy" / "diagnoses"
    monkeypatch.setenv(VARIABLE, str(tmp_path / "y"))
    assert folder() == tmp_path / "y" / "diagnoses"
    monkeypatch.setenv(VARIABLE, "")
    assert folder() is None
