"""Every number a recording may state: an absurd one gets one line, and what passes is tested for a gap."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np
import pytest
import zarr

from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import InputError
from mcstudy.gap.diagnose import detect
from mcstudy.gap.settings import FAST, DiagnosisSettings
from mcstudy.lines.labels import NOTED
from mcstudy.lines.readings import READINGS
from mcstudy.recordings.formats.netcdf_zarr import BODY
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording, write_recording
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import SEGMENTS, two_segment
from mcstudy.stance.stimulus import Prts

ABSURD = (0.0, -1.0, 1e-300, 1e-12, 1e300, float("nan"), float("inf"))

FORMATS = ("short.nc", "short.zarr", "short")

SEGMENT_VALUES = {"m1": 25.0, "h1": 0.55, "I1": 1.2, "m2": 52.0, "h2": 0.3, "I2": 2.4, "L1": 0.9}


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One short recording in every format, and an FRF of it."""
    folder = tmp_path_factory.mktemp("numbers")
    protocol = Protocol(waveform=Prts(stages=5, rate_hz=50.0), amplitudes=(5.0,), cycles=4)
    recording = simulate_recording(protocol, two_segment().truth, np.random.default_rng(0))
    for name in FORMATS:
        write_recording(recording, folder / name)
    f = np.array([0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
    rows = np.column_stack([f, 0.01 / f, -40 * f, 0.001 / f, 0.02 / f, 20 * f, 0.002 / f, 1e-7 / f, 0 * f])
    header = "f,gain1,phase1,sd1,gain2,phase2,sd2,c12_re,c12_im"
    np.savetxt(folder / "frf.csv", rows, delimiter=",", header=header, comments="")
    (folder / "frf.toml").write_text('body = {reference = "goodworth2018"}\nfrf = {file = "frf.csv"}\n')
    return folder


@pytest.fixture
def copy(tmp_path: Path, honest: Path) -> Path:
    return shutil.copytree(honest, tmp_path / "copy")


def said(run: Callable[[], object]) -> str:
    """The message of an `InputError`, "" without one; any other error, and any warning, comes out."""
    try:
        run()
    except InputError as error:
        return str(error)
    return ""


def refused_in_one_line_or_tested(path: Path, value: float) -> None:
    """Either an `InputError` of one line, which names the file, or a p-value."""
    accept = (*READINGS, *NOTED)
    message = said(lambda: read_recording(path))
    assert "\n" not in message, value
    if message:
        assert str(path.parent) in message, f"{value}: the line names no file"
        return
    recording = read_recording(path)
    key = content(recording)
    if key not in TESTED:
        p_values: list[float] = []
        message = said(lambda: p_values.append(detect(recording, DiagnosisSettings(fast=True, accept=accept)).p_value))
        assert "\n" not in message, value
        assert message or 0 <= p_values[0] <= 1, value
        TESTED.add(key)


TESTED: set[str] = set()
"""`content` of what was tested: many numbers change nothing that is analysed, and the tests would wait for it again."""


def content(recording: Recording | FrfRecording) -> str:
    """Hash of all that a test of a gap reads."""
    arrays = (
        [a for t in recording.trials for a in (t.stimulus, t.theta)]
        if isinstance(recording, Recording)
        else [recording.f, recording.y, recording.C]
    )
    rest = [getattr(recording, n, None) for n in ("rate_hz", "period_s", "stimulus", "body")]
    return sha256(repr(rest).encode() + b"".join(a.tobytes() for a in arrays)).hexdigest()


SHEET_FIELDS: dict[str, Callable[[str, str], str]] = {
    "rate_hz": lambda text, v: text.replace("rate_hz = 50.0", f"rate_hz = {v}"),
    "rate_hz without time": lambda text, v: text.replace("rate_hz = 50.0", f"rate_hz = {v}").replace(
        'file = "trial1.csv"',
        "\n".join(
            f'{c} = {{file = "trial1.csv", column = {k}}}' for k, c in enumerate(("stimulus", "theta1", "theta2"), 1)
        ),
    ),
    "period_s": lambda text, v: "\n".join(
        f"period_s = {v}" if line.startswith("period_s") else line for line in text.splitlines()
    ),
    "amplitude": lambda text, v: text.replace("amplitude = 5.0", f"amplitude = {v}"),
    **{
        f"{c}.scale": lambda text, v, c=c: text + f"{c} = {{scale = {v}}}\n"  # type: ignore[misc]
        for c in ("time", "stimulus", "theta1", "theta2")
    },
    **{f"body.{n}": lambda text, v, n=n: in_body(text, n, v) for n in BODY},  # type: ignore[misc]
    **{f"segments.{n}": lambda text, v, n=n: by_segments(text, n, v) for n in SEGMENTS},  # type: ignore[misc]
}


def in_body(text: str, name: str, value: str) -> str:
    (line,) = (line for line in text.splitlines() if line.startswith("body"))
    kept = [part for part in line.removeprefix("body = {").removesuffix("}").split(", ") if part.split(" ")[0] != name]
    return text.replace(line, f"body = {{{', '.join([*kept, f'{name} = {value}'])}}}")


def by_segments(text: str, name: str, value: str) -> str:
    (line,) = (line for line in text.splitlines() if line.startswith("body"))
    given = {n: value if n == name else str(v) for n, v in SEGMENT_VALUES.items()}
    return text.replace(line, f"body = {{{', '.join(f'{n} = {v}' for n, v in given.items())}}}")


@pytest.mark.parametrize("field", SHEET_FIELDS)
def test_a_number_of_a_sheet(copy: Path, field: str) -> None:
    sheet = copy / "short" / "recording.toml"
    text = sheet.read_text()
    for value in ABSURD:
        changed = SHEET_FIELDS[field](text, repr(value))
        assert changed != text
        sheet.write_text(changed)
        refused_in_one_line_or_tested(sheet, value)


def test_the_recordings_of_these_tests_are_tested_before_they_are_changed(copy: Path) -> None:
    sheet = copy / "short" / "recording.toml"
    sheet.write_text(by_segments(sheet.read_text(), "m1", "25.0"))
    for path in (*(copy / n for n in FORMATS[:2]), sheet, copy / "frf.toml"):
        assert 0 <= detect(read_recording(path), FAST).p_value <= 1


@pytest.mark.parametrize("cells", ["one", "all"])
@pytest.mark.parametrize("column", range(4))
def test_a_number_of_a_table(copy: Path, column: int, cells: str) -> None:
    file = copy / "short" / "trial1.csv"
    honest = np.loadtxt(file, delimiter=",", skiprows=1)
    for value in ABSURD:
        x = honest.copy()
        x[slice(None) if cells == "all" else 700, column] = value
        np.savetxt(file, x, delimiter=",", header="time,stimulus,theta1,theta2", comments="")
        refused_in_one_line_or_tested(copy / "short" / "recording.toml", value)


@pytest.mark.parametrize("cells", ["one", "all"])
@pytest.mark.parametrize("column", range(9))
def test_a_number_of_a_published_frf(copy: Path, column: int, cells: str) -> None:
    file = copy / "frf.csv"
    header = file.read_text().splitlines()[0]
    honest = np.loadtxt(file, delimiter=",", skiprows=1)
    for value in ABSURD:
        x = honest.copy()
        x[slice(None) if cells == "all" else 2, column] = value
        np.savetxt(file, x, delimiter=",", header=header, comments="")
        refused_in_one_line_or_tested(copy / "frf.toml", value)


@pytest.mark.parametrize("name", ["rate_hz", "period_s", "body.J1", "body.A2", "body.g"])
@pytest.mark.parametrize("kind", ["short.nc", "short.zarr"])
def test_a_number_among_the_attributes(copy: Path, kind: str, name: str) -> None:
    path = copy / kind

    def changed(attributes: dict[str, object], value: float) -> dict[str, object]:
        if not name.startswith("body."):
            return {name: value}
        return {"body": json.dumps({**json.loads(str(attributes["body"])), name.removeprefix("body."): value})}

    for value in ABSURD:
        if kind == "short.nc":
            with h5py.File(path, "a") as file:
                for key, new in changed(dict(file.attrs), value).items():
                    file.attrs[key] = new
        else:
            group = zarr.open_group(path, mode="r+")
            group.attrs.update(changed(dict(group.attrs), value))
        refused_in_one_line_or_tested(path, value)


@pytest.mark.parametrize("cells", ["one", "all"])
@pytest.mark.parametrize("name", ["time", "stimulus", "theta", "amplitude", "samples"])
@pytest.mark.parametrize("kind", ["short.nc", "short.zarr"])
def test_a_number_among_the_variables(copy: Path, kind: str, name: str, cells: str) -> None:
    path = copy / kind
    where = (..., slice(None)) if cells == "all" else (..., -1)
    with h5py.File(path) if kind == "short.nc" else nullcontext(zarr.open_group(path, mode="r")) as source:
        honest = np.asarray(source[name][...])
    for value in ABSURD:
        new = honest.astype(float)
        new[where] = value
        if kind == "short.zarr":
            array = zarr.open_group(path, mode="r+")[name]
            assert isinstance(array, zarr.Array)
            with np.errstate(invalid="ignore"):
                array[...] = new.astype(array.dtype)
        else:
            with h5py.File(path, "a") as file:
                if name == "samples":  # stored as whole numbers, which hold no nan
                    del file[name]
                    file[name] = new
                    file[name].dims[0].attach_scale(file["trial"])
                else:
                    file[name][...] = new
        refused_in_one_line_or_tested(path, value)
