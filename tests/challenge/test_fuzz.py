"""Whatever the files of a challenge hold: a result, or one line that says what was expected; never anything else."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from fuzzing import FUZZ
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcstudy_challenge import answer as answering
from mcstudy_challenge import files
from mcstudy_challenge import make as making
from mcstudy_challenge.challenge_file import read_challenge, resolve
from mcstudy_challenge.design import ChallengeFile
from mcstudy_challenge.scores.score import exit_code, score_files
from mcstudy_challenge.scores.table import score_text
from refusals import or_refused

from mcstudy.files import json_files
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording

CHALLENGE = """
[challenge]
name = "fuzz"
seed = 3
cases = 3

[mix]
none = 0.34
known = 0.33
outsider = 0.33
pair = 0.0
shifted = 0.0

[body]
spread = 0.15
decay = 0.2

[sizes]
effects = ["stimulus_gain"]
outsiders = ["leg_wobble"]
strata = [{share = 1.0, low = 4.0, high = 15.0}]

[protocol]
amplitudes = [5.0]
cycles = 3
fmax = 8.0

[noise]
psd = [4e-4, 7e-5]
level = 1.0
colour = 1.0
corner_hz = 0.15

[variant.white]
cases = 1
noise = {colour = 0.0}
"""


def in_turn(work: Callable[[Any], Any], items: Sequence[Any], options: object, what: str) -> Iterator[tuple[Any, Any]]:
    """`fan_out` without a scheduler."""
    del options, what
    for item in items:
        yield item, work(item)


def a_cause(recording: object) -> dict[str, Any]:
    """An answer that has something in every place."""
    del recording
    return {
        "detected": True,
        "p_value": 0.01,
        "causes": [
            {
                "effects": ["stimulus_gain"],
                "alternatives": [["stimulus_gain", "stimulus_delay"]],
                "probability": 0.9,
                "size": {"eps_stim": {"estimate": 0.1, "low": 0.05, "high": 0.2}},
            },
            {
                "effects": ["head_mode", "force_feedback"],
                "alternatives": [["head_mode"], ["force_feedback"]],
                "probability": 0.05,
                "size": {},
            },
        ],
        "none_probability": 0.03,
        "unknown_probability": 0.02,
        "credible_set": [
            {"cause": "named", "effects": ["stimulus_gain"]},
            {"cause": "named", "effects": ["force_feedback", "head_mode"]},
            {"cause": "none"},
        ],
        "place": {"ankle": 0.2, "stimulus": 0.8},
        "closed": {"fraction": 0.9, "low": 0.8, "high": 1.0},
    }


class Made:
    """A challenge with answers, its files as they should be, and their recordings."""

    def __init__(self, folder: Path) -> None:
        self.file: ChallengeFile = resolve_text(folder, CHALLENGE)
        self.data, self.key, self.answers = folder / "data", folder / "key.json", folder / "answers.json"
        self.entries: dict[str, tuple[Recording, dict[str, Any]]] = {}
        making.make(self.file, self.data, self.key)
        answering.answer(self.data, self.answers, a_cause, "stub")
        for case in json.loads(self.key.read_text())["cases"]:
            self.entries[case["name"]] = read_recording(self.data / f"{case['name']}.nc"), case
        self.sound = {p: p.read_bytes() for p in (self.key, self.answers, self.manifest)}

    @property
    def manifest(self) -> Path:
        return self.data / files.MANIFEST

    def score(self) -> None:
        """Score and print."""
        result = score_files(self.data, self.key, self.answers)
        json_files.json_text(result, "challenge_score", "score")
        assert score_text(result).isprintable() or "\n" in score_text(result)
        assert exit_code(result) in (0, 5)

    def seal(self) -> None:
        """The digests a cheat would write: of the key into the manifest, of the manifest into the answers."""
        manifest = json.loads(self.manifest.read_bytes()) | {"key_sha256": json_files.digest(self.key)}
        self.manifest.write_text(json.dumps(manifest))
        answers = json.loads(self.answers.read_bytes()) | {"manifest_sha256": json_files.digest(self.manifest)}
        self.answers.write_text(json.dumps(answers))

    def restore(self) -> None:
        """Everything as it was."""
        for path, content in self.sound.items():
            path.write_bytes(content)


def resolve_text(folder: Path, content: str) -> ChallengeFile:
    file = folder / "c.toml"
    file.write_text(content)
    return read_challenge(file)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Made]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(making, "fan_out", in_turn)
        patch.setattr(answering, "fan_out", in_turn)
        whole = Made(tmp_path_factory.mktemp("fuzz"))
        # What is asked for again is what was made already: the files are tried here, not the simulator.
        patch.setattr(making, "make_case", lambda _, case: whole.entries[case.name])
        patch.setattr(making, "check_visible", lambda _: None)
        patch.setattr(answering, "read_recording", lambda path: whole.entries[path.stem][0])
        yield whole


text_edits = st.lists(
    st.tuples(
        st.floats(0, 1),
        st.text(max_size=8)
        | st.sampled_from(
            ["1e400", "nan", "NaN", "[[", "=", "'''", "9" * 30, "-", "[" * 400, '"', "{}", ",", "\\ud800"]
        ),
        st.integers(0, 8),
    ),
    min_size=1,
    max_size=5,
)


def edited(content: str, edits: list[tuple[float, str, int]]) -> bytes:
    for where, new, gone in edits:
        at = int(where * len(content))
        content = content[:at] + new + content[at + gone :]
    return content.encode("utf-8", "surrogatepass")


numbers = st.integers() | st.floats() | st.sampled_from([0, 1, -1, 0.5, 1.8, 1e300, -1e300, 1e-300, 10**18, 10**30])
json_values = st.recursive(
    st.none()
    | st.booleans()
    | numbers
    | st.text(max_size=6)
    | st.sampled_from(["none", "unknown", "head_mode", "a+b"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
changes = st.lists(st.tuples(st.integers(0, 10**6), json_values), min_size=1, max_size=3)


def changed(document: Any, what: list[tuple[int, Any]]) -> Any:
    """A document with other values in some of its places."""
    document = copy.deepcopy(document)
    for where, value in what:
        places = list(walk(document))
        parent, key = places[where % len(places)]
        parent[key] = copy.deepcopy(value)
    return document


def walk(value: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield value, key
        yield from walk(value[key])


@FUZZ
@given(edits=text_edits)
def test_a_mutated_challenge_file_is_valid_or_refused(tmp_path: Path, edits: list[tuple[float, str, int]]) -> None:
    file = tmp_path / "c.toml"
    file.write_bytes(edited(CHALLENGE, edits))
    found = or_refused(lambda: read_challenge(file))
    assert found is None or found.total > 0


@FUZZ
@given(what=changes)
def test_any_value_in_a_challenge_file_is_valid_or_refused(what: list[tuple[int, Any]]) -> None:
    found = or_refused(lambda: resolve(changed(tomllib.loads(CHALLENGE), what)))
    assert found is None or len(found.fingerprint) == 64


@FUZZ
@given(which=st.sampled_from(["key", "answers", "manifest"]), edits=text_edits, sealed=st.booleans())
def test_a_mutated_file_of_a_challenge_is_scored_or_refused(
    made: Made, which: str, edits: list[tuple[float, str, int]], sealed: bool
) -> None:
    path: Path = getattr(made, which)
    path.write_bytes(edited(made.sound[path].decode(), edits))
    try:
        if sealed and all(is_table(p) for p in made.sound):
            made.seal()
        or_refused(made.score)
        or_refused(lambda: files.read_manifest(made.data))
    finally:
        made.restore()


def is_table(path: Path) -> bool:
    try:
        return isinstance(json.loads(path.read_bytes()), dict)
    except (ValueError, RecursionError):
        return False


@FUZZ
@given(which=st.sampled_from(["key", "answers", "manifest"]), what=changes)
@example(which="key", what=[(220, {"\n": None})])
def test_any_value_in_a_file_of_a_challenge_is_scored_or_refused(
    made: Made, which: str, what: list[tuple[int, Any]]
) -> None:
    path: Path = getattr(made, which)
    path.write_text(json.dumps(changed(json.loads(made.sound[path]), what)))
    try:
        made.seal()
        or_refused(made.score)
    finally:
        made.restore()


@settings(FUZZ, max_examples=FUZZ.max_examples // 3)
@given(kind=st.sampled_from(sorted(files.PARTS)), what=changes, edits=st.none() | text_edits)
def test_any_part_is_taken_or_done_again(
    made: Made, tmp_path: Path, kind: str, what: list[tuple[int, Any]], edits: list[tuple[float, str, int]] | None
) -> None:
    """Whatever a part holds, what comes out can be scored - unless the part says it is of another challenge."""
    name = "case1"
    if kind == "challenge_key":
        sha = json.loads(made.sound[made.manifest])["files"][f"{name}.nc"]
        part: dict[str, Any] = {"fingerprint": made.file.fingerprint, "sha256": sha, "truth": made.entries[name][1]}
    else:
        given_answer = next(a for a in json.loads(made.sound[made.answers])["answers"] if a["name"] == name)
        part = {"manifest_sha256": json_files.digest(made.manifest), "method": "stub", "answer": given_answer}
    content = json.dumps(changed(part, what)).encode() if edits is None else edited(json.dumps(part), edits)
    out = tmp_path / "out.json"
    for leftover in (out, files.partial_folder(out) / f"{name}.json"):
        leftover.unlink(missing_ok=True)
    files.partial_folder(out).mkdir(exist_ok=True)
    (files.partial_folder(out) / f"{name}.json").write_bytes(content)
    if kind == "challenge_key":
        made.manifest.unlink()
        try:
            or_refused(lambda: making.make(made.file, made.data, out))
        finally:
            made.restore()
    elif or_refused(lambda: answering.answer(made.data, out, a_cause, "stub")):
        score_files(made.data, made.key, out)
