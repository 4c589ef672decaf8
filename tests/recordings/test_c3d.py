"""C3D files as laboratories have them: every frame and channel is read, however the file counts them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c3d_writer import write_c3d

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats import c3d
from mcstudy.recordings.formats.c3d import variables_of

RATE = 100.0


def points(n: int, count: int = 2) -> dict[str, np.ndarray]:
    """Markers M0, M1, ... of n frames, none of them at zero, mm."""
    k = np.arange(n)
    return {
        f"M{j}": np.stack([100.0 + j + k % 97, 200.0 + k % 89, 300.0 + np.sin(k / 50)], axis=1) for j in range(count)
    }


def channels(n: int, count: int = 2) -> dict[str, np.ndarray]:
    return {f"A{j}": 1.0 + j + np.arange(n) % 83 for j in range(count)}


def values(path: Path) -> dict[str, np.ndarray]:
    return {name: variable.read() for name, variable in variables_of(path).items()}


def expect(path: Path, marks: dict[str, np.ndarray], analog: dict[str, np.ndarray], within: float = 1e-4) -> None:
    """The file holds these coordinates and channels, in number and value, and nothing else."""
    found = values(path)
    wanted = {f"{m}.{axis}": v[:, k] for m, v in marks.items() for k, axis in enumerate("xyz")} | analog
    assert list(found) == list(wanted)
    for name, value in wanted.items():
        np.testing.assert_allclose(found[name], value, atol=within, rtol=0, err_msg=name)


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        variables_of(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


ACTUAL = "TRIAL:ACTUAL_START_FIELD", "TRIAL:ACTUAL_END_FIELD"


def field(n: int) -> np.ndarray:
    """A whole number of 32 bits in two words, as in TRIAL."""
    return np.uint16([n % 65536, n // 65536]).view(np.int16)


@pytest.mark.parametrize("fill", [True, False], ids=["filled", "as long as its data"])
@pytest.mark.parametrize(
    "stated",
    [
        {"first": 1},
        {"first": 0},  # frames 0 to 499
        {"first": 0, "header": {4: 500}},  # frames 0 to 500, of which the last is not there
        {"first": 0, "parameters": {"POINT:FRAMES": np.int16([501])}},
        {"first": 1, "parameters": {"POINT:FRAMES": np.int16([499])}},
        {"first": 1, "parameters": {"POINT:FRAMES": None}},
        {"first": 3000, "parameters": {"POINT:FRAMES": None}},  # a piece of a longer trial
        {"header": {3: 1, 4: 0}},  # never brought up to date while recording
        {"header": {3: 0, 4: 0}, "parameters": {"POINT:FRAMES": np.int16([0])}},
        {"parameters": {"POINT:FRAMES": np.float32([500])}},
        {"header": {3: 0, 4: 0}, "parameters": {"POINT:FRAMES": None, ACTUAL[0]: field(1), ACTUAL[1]: field(500)}},
        {"header": {3: 0, 4: 0}, "parameters": {"POINT:FRAMES": None, ACTUAL[0]: field(0), ACTUAL[1]: field(499)}},
        {"header": {3: 0, 4: 0}, "parameters": {"POINT:FRAMES": None, ACTUAL[0]: field(0), ACTUAL[1]: field(500)}},
    ],
    ids=str,
)
def test_the_frames_that_are_there_are_read_however_they_are_counted(
    tmp_path: Path, stated: dict[str, Any], fill: bool
) -> None:
    marks, analog = points(500), channels(500)
    write_c3d(tmp_path / "a.c3d", marks, analog, RATE, fill=fill, **stated)
    expect(tmp_path / "a.c3d", marks, analog)


@pytest.mark.parametrize("n", [65_534, 65_535, 65_536, 65_537, 70_000, 140_000])
@pytest.mark.parametrize(
    "stated",
    [
        lambda _: {},
        lambda n: {"POINT:FRAMES": np.float32([n])},
        lambda n: {"POINT:LONG_FRAMES": np.float32([n])},
        lambda n: {ACTUAL[0]: field(1), ACTUAL[1]: field(n)},
        lambda _: {"POINT:FRAMES": np.int16([-1])},
    ],
    ids=["16 bits", "FRAMES", "LONG_FRAMES", "TRIAL", "full"],
)
def test_more_frames_than_16_bits_count_are_read(tmp_path: Path, n: int, stated: Any) -> None:
    marks, analog = points(n, 1), channels(n, 1)
    write_c3d(tmp_path / "a.c3d", marks, analog, RATE, parameters=stated(n))
    expect(tmp_path / "a.c3d", marks, analog)


@pytest.mark.parametrize("n", [512, 65_536])
def test_a_whole_block_behind_the_last_frame_is_no_frame(tmp_path: Path, n: int) -> None:
    """Some programs fill up the last block also where it is full."""
    marks, analog = points(n, 1), channels(n, 1)
    write_c3d(tmp_path / "a.c3d", marks, analog, RATE)
    raw = (tmp_path / "a.c3d").read_bytes()
    (tmp_path / "a.c3d").write_bytes(raw + b"\0" * ((-len(raw)) % 512 or 512))
    expect(tmp_path / "a.c3d", marks, analog)


@pytest.mark.parametrize("stated", [{}, {"POINT:LONG_FRAMES": np.float32([70_000])}], ids=str)
@pytest.mark.parametrize("n", [400, 70_000])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, n: int, stated: dict[str, Any]) -> None:
    write_c3d(tmp_path / "a.c3d", points(n, 1), channels(n, 1), RATE, parameters=stated if n > 65_535 else {})
    raw = (tmp_path / "a.c3d").read_bytes()
    (tmp_path / "a.c3d").write_bytes(raw[: len(raw) - 20 * 90])
    if n == 400 or stated:
        assert f"cut off: {n} frames declared, " in refusal(tmp_path / "a.c3d")


def test_frames_that_nothing_declares_are_not_dropped_in_silence(tmp_path: Path) -> None:
    write_c3d(tmp_path / "a.c3d", points(400), channels(400), RATE, header={4: 200},
              parameters={"POINT:FRAMES": np.int16([200])})  # fmt: skip
    assert "200 frames declared (POINT:FRAMES and header), 400 are there" in refusal(tmp_path / "a.c3d")


@pytest.mark.parametrize("processor", ["intel", "dec", "mips"])
@pytest.mark.parametrize("count", [0, 1, 2, 5])
@pytest.mark.parametrize("per_frame", [1, 10])
@pytest.mark.parametrize("scale", [-1.0, 0.01], ids=["floats", "integers"])
def test_every_processor_and_number_of_channels(
    tmp_path: Path, processor: str, count: int, per_frame: int, scale: float
) -> None:
    marks, analog = points(40), channels(40 * per_frame, count)
    marks["M1"][7:9] = np.nan
    write_c3d(tmp_path / "a.c3d", marks, analog, RATE, processor=processor, scale=scale, analog_scale=0.05, offset=2048)
    expect(tmp_path / "a.c3d", marks, analog, within=0.03 if scale > 0 else 1e-4)
    found = variables_of(tmp_path / "a.c3d")
    assert found["M0.x"].unit == "mm"
    assert [found[name].rate_hz for name in analog] == [RATE * per_frame] * count


@pytest.mark.parametrize("processor", ["intel", "dec", "mips"])
def test_unsigned_channels_have_unsigned_offsets(tmp_path: Path, processor: str) -> None:
    analog = {"A": np.linspace(-3000.0, 30_000.0, 40)}
    write_c3d(tmp_path / "a.c3d", points(40), analog, RATE, processor=processor, scale=0.01, offset=33_000,
              parameters={"ANALOG:FORMAT": "UNSIGNED"})  # fmt: skip
    expect(tmp_path / "a.c3d", points(40), analog, within=0.6)


@pytest.mark.parametrize("factors", [np.float32(0.5), np.float32([0.5]), np.float32([0.5, 0.5, 0.5])], ids=str)
def test_one_factor_and_offset_are_those_of_every_channel(tmp_path: Path, factors: Any) -> None:
    analog = channels(40, 3)
    write_c3d(tmp_path / "a.c3d", {}, analog, RATE, analog_scale=0.5, offset=3,
              parameters={"ANALOG:SCALE": factors, "ANALOG:OFFSET": np.int16(3)})  # fmt: skip
    expect(tmp_path / "a.c3d", {}, analog)
    write_c3d(tmp_path / "a.c3d", {}, analog, RATE, parameters={"ANALOG:SCALE": np.float32([1.0, 1.0])})
    assert "ANALOG:SCALE: expected a number for each of 3 channels, got 2" in refusal(tmp_path / "a.c3d")


def test_a_file_of_rotations_says_that_it_holds_no_points(tmp_path: Path) -> None:
    write_c3d(tmp_path / "a.c3d", {}, {"A": np.ones(40)}, RATE,
              parameters={"ANALOG:USED": np.int16([0]), "ROTATION:USED": np.int16([21])})  # fmt: skip
    assert "found 21 rotations of segments only; export the file again with markers or joint" in refusal(
        tmp_path / "a.c3d"
    )
    write_c3d(tmp_path / "a.c3d", {}, {"A": np.ones(40)}, RATE, parameters={"ANALOG:USED": np.int16([0])})
    assert "expected C3D: points or analog channels, found none" in refusal(tmp_path / "a.c3d")


def test_rotations_behind_the_points_are_not_read_as_points(tmp_path: Path) -> None:
    marks, analog = points(64), channels(64)
    write_c3d(tmp_path / "a.c3d", marks, analog, RATE)
    whole = (tmp_path / "a.c3d").stat().st_size
    data = {"ROTATION:USED": np.int16([2]), "ROTATION:DATA_START": np.int16([whole // 512 + 1])}
    write_c3d(tmp_path / "a.c3d", marks, analog, RATE, parameters=data)
    assert (tmp_path / "a.c3d").stat().st_size == whole
    with (tmp_path / "a.c3d").open("ab") as file:
        file.write(np.ones(4096, np.float32).tobytes())
    expect(tmp_path / "a.c3d", marks, analog)


def test_units_are_those_of_the_kind_of_point(tmp_path: Path) -> None:
    write_c3d(tmp_path / "a.c3d", points(40, 4), {}, RATE, units="m", parameters={
        "POINT:ANGLES": ["M1"], "POINT:ANGLE_UNITS": "rad", "POINT:MOMENTS": ["M2"], "POINT:MOMENT_UNITS": "Nmm",
        "POINT:FORCES": ["M3"]})  # fmt: skip
    found = variables_of(tmp_path / "a.c3d")
    assert [found[f"M{k}.x"].unit for k in range(4)] == ["m", "rad", "Nmm", None]


def test_labels_and_factors_beyond_255_continue(tmp_path: Path) -> None:
    analog = {f"A{k}": 1.0 + k + np.arange(20) for k in range(300)}
    names, ones = list(analog), np.ones(300, np.float32)
    write_c3d(tmp_path / "a.c3d", {}, analog, RATE, analog_scale=2.0, parameters={
        "ANALOG:LABELS": names[:255], "ANALOG:LABELS2": names[255:], "ANALOG:SCALE": 2 * ones[:255],
        "ANALOG:SCALE2": 2 * ones[255:], "ANALOG:OFFSET": np.int16([0])})  # fmt: skip
    expect(tmp_path / "a.c3d", {}, analog)


@pytest.mark.parametrize(("first", "start"), [(0, 0.0), (1, 0.0), (501, 5.0)])
def test_events_count_from_the_first_frame(tmp_path: Path, first: int, start: float) -> None:
    write_c3d(tmp_path / "a.c3d", points(40), {}, RATE, first=first, events={"go": [start + 0.1, start + 65.0]})
    np.testing.assert_allclose(values(tmp_path / "a.c3d")["EVENT.go"], [0.1, 65.0], atol=1e-5)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("per_frame", [1, 10])
def test_ezc3d_and_this_reader_agree(tmp_path: Path, count: int, per_frame: int) -> None:
    """An independent program writes a file, and reads what the tests write by hand."""
    ezc3d = pytest.importorskip("ezc3d")
    marks, analog = points(500, 3), channels(500 * per_frame, count)
    file = ezc3d.c3d()
    stated = file["parameters"]
    stated["POINT"]["RATE"]["value"], stated["ANALOG"]["RATE"]["value"] = [RATE], [RATE * per_frame]
    stated["POINT"]["LABELS"]["value"], stated["ANALOG"]["LABELS"]["value"] = list(marks), list(analog)
    file["data"]["points"] = np.concatenate([np.stack(list(marks.values())).transpose(2, 0, 1), np.ones((1, 3, 500))])
    file["data"]["analogs"] = np.stack(list(analog.values()))[None]
    file.write(str(tmp_path / "theirs.c3d"))
    expect(tmp_path / "theirs.c3d", marks, analog)
    write_c3d(tmp_path / "ours.c3d", marks, analog, RATE)
    file = ezc3d.c3d(str(tmp_path / "ours.c3d"))
    data = file["data"]
    np.testing.assert_allclose(data["points"][:3].transpose(1, 2, 0), list(marks.values()), atol=1e-4)
    np.testing.assert_allclose(data["analogs"][0], list(analog.values()))


def test_more_variables_than_allowed_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c3d, "MOST_VARIABLES", 7)
    write_c3d(tmp_path / "a.c3d", points(40), channels(40), RATE)
    assert "at most 7 points and channels" in refusal(tmp_path / "a.c3d")
