"""Recordings survive every format, and what cannot be analysed is refused in one line that names the field."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from fuzzing import MANY

from mcstudy.errors import RecordingError
from mcstudy.files import schema
from mcstudy.files.reading_process import Answer, answer
from mcstudy.lines.checked_recording import checked_recording
from mcstudy.lines.readings import READINGS
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.assembly import read_sheet
from mcstudy.recordings.checks import check
from mcstudy.recordings.formats import netcdf_zarr, text
from mcstudy.recordings.formats.netcdf_zarr import header, read_dataset, to_dataset, write_csv, write_netcdf, write_zarr
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.guards import check_zarr, inside, regular
from mcstudy.recordings.io import read_recording, write_recording
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.stance.body import STIMULI, TORQUES, Body, two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway
from mcstudy.stance.stimulus import Prts

PRTS = Prts(rate_hz=100.0)


def sway(trials: int = 1, cycles: int = 3, seed: int = 0, kind: str = "ankle_torque", scale: float = 1.0) -> Recording:
    """Sway of the nominal model in steady state at 100 Hz."""
    model, u = two_segment(stimulus=kind), scale * PRTS.waveform()
    evoked = stimulus_sway(model, model.truth, u, PRTS.rate_hz)
    n = cycles * PRTS.samples
    noise = NoiseSway(model, model.truth, SensorNoise(), 2 * n, PRTS.rate_hz)
    rng = np.random.default_rng(seed)
    records = tuple(
        Trial(np.tile(u, cycles), np.tile(evoked, (cycles, 1)) + noise.sample(rng)[:n], scale * PRTS.amplitude)
        for _ in range(trials)
    )
    return Recording(records, PRTS.rate_hz, PRTS.period_s, kind, name="sway", provenance="test")


SWAY = sway()


def changed(change: Callable[[np.ndarray], object], recording: Recording = SWAY) -> Recording:
    """The recording after ``change`` on a copy of its first trial's columns (stimulus, theta1, theta2)."""
    first = recording.trials[0]
    x = np.column_stack([first.stimulus, first.theta])
    change(x)
    return replace(recording, trials=(Trial(x[:, 0], x[:, 1:], first.amplitude), *recording.trials[1:]))


def mixed(matrix: tuple[tuple[float, float], tuple[float, float]], recording: Recording = SWAY) -> Recording:
    """The recording with its channels mixed by a 2 x 2 matrix."""
    T = np.array(matrix)
    return replace(recording, trials=tuple(replace(t, theta=t.theta @ T.T) for t in recording.trials))


@pytest.mark.parametrize("name", ["sway.nc", "sway.zarr", "sway"])
def test_a_recording_survives_every_format(tmp_path: Path, name: str) -> None:
    recording = replace(sway(trials=2, scale=0.6), body=Body(J1=51.0))
    shorter = replace(
        recording.trials[1], stimulus=recording.trials[1].stimulus[:-7], theta=recording.trials[1].theta[:-7]
    )
    extended = np.tile(recording.trials[0].stimulus, 2), np.tile(recording.trials[0].theta, (2, 1))
    recording = replace(recording, trials=(Trial(*extended, 3.0), replace(shorter, amplitude=None)))
    recording = replace(recording, trials=(recording.trials[0], replace(recording.trials[0], amplitude=None)))
    back = read_recording(write_recording(recording, tmp_path / name))
    assert isinstance(back, Recording)
    assert (back.name, back.rate_hz, back.period_s, back.stimulus) == ("sway", 100.0, PRTS.period_s, "ankle_torque")
    assert back.body == recording.body
    assert back.provenance == "test"
    assert back.suspicions == check(recording)
    for a, b in zip(back.trials, recording.trials, strict=True):
        assert a.amplitude == b.amplitude
        np.testing.assert_allclose(a.stimulus, b.stimulus, rtol=1e-11, atol=1e-14)
        np.testing.assert_allclose(a.theta, b.theta, rtol=1e-10, atol=1e-14)


def test_trials_of_unequal_length_are_padded_and_cut_again(tmp_path: Path) -> None:
    longer = sway(cycles=4).trials[0]
    recording = replace(SWAY, trials=(SWAY.trials[0], longer))
    back = read_recording(write_recording(recording, tmp_path / "r.nc"))
    assert isinstance(back, Recording)
    assert back.cycles == (3, 4)


def test_a_written_file_is_labelled_without_this_program(tmp_path: Path) -> None:
    write_recording(SWAY, tmp_path / "r.zarr")
    dataset = xr.open_zarr(tmp_path / "r.zarr", consolidated=False, decode_timedelta=False)
    assert dataset["theta"].dims == ("trial", "time", "angle")
    assert dataset["theta"].attrs["units"] == "rad"
    assert dataset["stimulus"].attrs["units"] == "N m"


def test_the_schema_describes_what_is_written_and_refuses_another_type() -> None:
    described = header(to_dataset(SWAY))
    schema.validate("recording", described, "r")
    described["variables"]["theta"]["dtype"] = "int64"
    with pytest.raises(Exception, match=r"variables\.theta\.dtype"):
        schema.validate("recording", described, "r")


def gap_in_the_values(x: np.ndarray) -> None:
    x[500:520, 2] = np.nan


def infinite_stimulus(x: np.ndarray) -> None:
    x[3, 0] = np.inf


def constant_angle(x: np.ndarray) -> None:
    x[:, 1] = 0.1


def copied_angle(x: np.ndarray) -> None:
    x[:, 2] = x[:, 1]


def degrees(x: np.ndarray) -> None:
    x[:, 1:] *= 180 / np.pi


def other_period(x: np.ndarray) -> None:
    x[:, 0] = np.resize(x[:4000, 0], x.shape[0])


def stuck_sensor(x: np.ndarray) -> None:
    x[1000:1400, 2] = x[1000, 2]


@pytest.mark.parametrize(
    ("recording", "message"),
    [
        (changed(gap_in_the_values), "trial 1: theta2: 20 of 13116 values are not numbers, the first at t = 5 s"),
        (changed(infinite_stimulus), "stimulus: 1 of"),
        (changed(constant_angle), "theta1: constant"),
        (changed(copied_angle), "theta2: identical to theta1"),
        (changed(degrees), "theta1, theta2: seems to be in deg but declared rad"),
        (sway(cycles=2), "period_s: expected at least 3 cycles of 43.72 s, got 2.00"),
        (replace(SWAY, period_s=41.0), "does not repeat every 41 s .*it repeats every 43.72 s"),
        (replace(SWAY, period_s=41.003), "41.003 s is 4100.300 samples at 100 Hz; expected a whole number"),
        (replace(sway(cycles=6), period_s=2 * 43.72), "87.44 s contains 2 periods"),
        (changed(other_period), "period_s: the stimulus does not repeat every 43.72 s .*every 40 s"),
        (replace(SWAY, convention="peak_to_peak"), "amplitude: 5 N m is stated as peak_to_peak.* convention is peak"),
        (mixed(((0, 1), (1, 0))), "theta1, theta2: seems to be exchanged"),
        (mixed(((1, 0), (0, -1))), "theta2: seems to be of the wrong sign"),
        (mixed(((np.pi / 180, 0), (0, np.pi / 180))), "in rad but declared deg"),
        (mixed(((1, 0), (0, 180 / np.pi))), "theta2: (sways|seems to be in deg)"),
    ],
)
def test_what_cannot_be_analysed_is_refused_by_name(recording: Recording, message: str) -> None:
    with pytest.raises(RecordingError, match=message) as caught:
        checked_recording(recording)
    assert "\n" not in str(caught.value)


KINDS = [k for k in STIMULI if k != "visual_tilt"]


@pytest.mark.parametrize("kind", KINDS)
def test_every_mislabelled_channel_is_recognised(kind: str) -> None:
    """Every reading with every other kind of stimulus, so with a torque and without; ``MCSTUDY_FUZZ=1``: with every."""
    recording = sway(kind=kind, scale={"rad": 0.003, "m": 0.01}.get(STIMULI[kind], 1.0))
    assert checked_recording(recording).recording.suspicions == ()
    for k, (name, reading) in enumerate(READINGS.items()):
        if not MANY and (k + KINDS.index(kind)) % 2:
            continue
        matrix = reading.matrix
        if name == "space_angle" or reading.check == "fit":
            continue  # the hip is half the trunk's angle: told apart only by the fit
        if any(reading.orders) or (reading.torque and kind not in TORQUES):
            continue
        if "degrees" in name or name in ("thousand", "thousand_theta1", "thousand_theta2"):
            with pytest.raises(RecordingError, match="deg"):
                checked_recording(mixed(matrix, recording))
            continue
        found = checked_recording(mixed(matrix, recording), LineSettings(accept=READINGS)).recording.suspicions
        assert found[0].code == name


VELOCITIES = {name: r.orders for name, r in READINGS.items() if 1 in r.orders}


@pytest.mark.parametrize("name", VELOCITIES)
def test_an_angular_velocity_in_place_of_an_angle_is_recognised(name: str) -> None:
    recording = sway()
    trials = []
    for trial in recording.trials:
        speed = np.gradient(trial.theta, 1 / recording.rate_hz, axis=0)
        trials.append(replace(trial, theta=np.where(VELOCITIES[name], speed, trial.theta)))
    found = checked_recording(
        replace(recording, trials=tuple(trials)), LineSettings(accept=READINGS)
    ).recording.suspicions
    assert found[0].code == name


@pytest.mark.parametrize("ratio", [1.01, 0.99, 1.003])
def test_angles_of_another_clock_than_the_stimulus_are_refused_for_that_reason(ratio: float) -> None:
    recording = sway(trials=2, cycles=5)
    trials = []
    for trial in recording.trials:
        at = np.arange(trial.samples)
        slow = np.column_stack([np.interp(at * ratio, at, trial.theta[:, c]) for c in (0, 1)])
        trials.append(replace(trial, theta=slow))
    word = "earlier .* slower" if ratio > 1 else "later .* faster"
    with pytest.raises(RecordingError, match=rf"theta1, theta2: answer .* {word} than that of the stimulus"):
        check(replace(recording, trials=tuple(trials)))


def test_an_amplitude_may_be_a_whole_number(tmp_path: Path) -> None:
    whole = replace(SWAY, trials=(replace(SWAY.trials[0], amplitude=5),))
    write_recording(whole, tmp_path / "whole.nc")
    assert read_recording(tmp_path / "whole.nc").trials[0].amplitude == 5.0


def test_an_amplitude_that_matches_no_convention_is_noted_not_refused() -> None:
    odd = replace(SWAY, trials=(replace(SWAY.trials[0], amplitude=3.7),))
    assert [s.code for s in checked_recording(odd).recording.suspicions] == ["amplitude"]


def test_a_stuck_sensor_is_noted() -> None:
    assert [(s.code, s.channel) for s in checked_recording(changed(stuck_sensor)).recording.suspicions] == [
        ("stuck", "theta2")
    ]


# --- files ---


def sheet(folder: Path, text: str = "", rows: str | None = None) -> Path:
    t = np.arange(0, 30, 0.01)
    table = np.column_stack([t, np.sin(t), 0.01 * np.cos(t), 0.01 * np.sin(2 * t)])
    body = rows if rows is not None else "\n".join(",".join(f"{v:.6f}" for v in row) for row in table)
    (folder / "a.csv").write_text("time,stimulus,theta1,theta2\n" + body + "\n")
    base = 'body = {reference = "goodworth2018"}\n[[trials]]\nfile = "a.csv"\n'
    path = folder / "a.toml"
    path.write_text(text or base)
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rate_hz = 50\nbody = {reference = 'goodworth2018'}\n[[trials]]\nfile = 'a.csv'\n", "rate_hz: stated 50 Hz"),
        ("rate = 50\n", r"a\.toml: rate: unknown key, expected one of stimulus, name, "),
        ("[[trials]]\nfile = 'a.csv'\n", "body: expected J1"),
        ("body = {J1 = 50}\n[[trials]]\nfile = 'a.csv'\n", "body: J2, C1, C2, A1, A2 missing"),
        ("body = {reference = 'goodworth2018'}\n", "trials: expected at least one"),
        ("body = {reference = 'goodworth2018'}\n[[trials]]\nfile = 'b.csv'\n", r"b\.csv: cannot be read"),
        ("stimulus = 'tilt'\nbody = {reference = 'goodworth2018'}\n", "stimulus: expected one of ankle_torque"),
        (
            "body = {reference = 'goodworth2018'}\n[[trials]]\nfile = 'a.csv'\ntheta2 = {column = 'hip'}\n",
            "column 'hip' is missing; found time, stimulus, theta1, theta2",
        ),
        (
            "units = {angle = 'grad'}\nbody = {reference = 'goodworth2018'}\n[[trials]]\nfile = 'a.csv'\n",
            "theta1: unit: expected one of rad",
        ),
        ("rate_hz = \n", "expected TOML"),
        ("[study]\nname = 'x'\nseed = 1\n", "this is a study file .*; expected a recording"),
        ("[challenge]\nname = 'x'\nseed = 1\n", "this is a challenge file .*; expected a recording"),
        ("[group.theory]\nrealizations = 1\n", "this is a study file .*; expected a recording"),
        (
            "body = {J1 = 10, J2 = 7.08, C1 = 11.93, C2 = 19.01, A1 = 50, A2 = 14}\n[[trials]]\nfile = 'a.csv'\n",
            r"a\.toml: body: expected J1, J2, C1, C2 of a body \(positive definite inertia\)",
        ),
        (
            "body = {m1 = -25, h1 = 0.55, I1 = 1, m2 = 52, h2 = 0.3, I2 = 2, L1 = 0.9}\n[[trials]]\nfile = 'a.csv'\n",
            r"a\.toml: body\.m1: ",
        ),
    ],
)
def test_a_bad_sheet_gets_one_clear_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message) as caught:
        read_recording(sheet(tmp_path, text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,1,2,3\n0.01,1,x,3\n", "line 3, column 'theta1': expected a number, got 'x'"),
        ("0,1,2,3\n0.01,1,3\n", "line 3: expected 4 columns, got 3"),
        ("\n".join(f"{t},1,2,{t}" for t in [*range(20), *range(25, 40)]), "gap of 6 s after t = 19 s"),
        ("\n".join(f"{t},1,2,{t}" for t in [*range(20), 5, *range(25, 40)]), "does not increase after t = 19 s"),
        ("", "expected rows of numbers under the header"),
        ("0,1,2,1_000\n1,1,2,3\n", "line 2, column 'theta2': expected a number, got '1_000'"),
        ("0,1,2,٣\n1,1,2,3\n", "line 2, column 'theta2': expected a number, got '٣'"),
        ("0,1,2,3\n1,1,1e16,3\n", r"line 3, column 'theta1': expected numbers up to 1e\+15, got 1e\+16"),
    ],
)
def test_a_bad_table_gets_one_clear_line(tmp_path: Path, rows: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        read_recording(sheet(tmp_path, rows=rows))


def test_exchanged_segments_are_remarked_on(tmp_path: Path) -> None:
    segments = "m1 = 46.0, h1 = 0.314, I1 = 2.54, m2 = 24.0, h2 = 0.518, I2 = 1.53, L1 = 0.826"
    found = read_recording(sheet(tmp_path, f'body = {{{segments}}}\n[[trials]]\nfile = "a.csv"\n'))
    assert "(m1 = 46 kg) is heavier than the upper body (m2 = 24 kg); are the segments exchanged?" in found.provenance


def test_files_that_are_not_recordings_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_bytes(b"not a file")
    with pytest.raises(RecordingError, match=r"a\.nc: expected NetCDF or Zarr"):
        read_recording(tmp_path / "a.nc")
    (tmp_path / "a.zarr").mkdir()
    with pytest.raises(RecordingError, match=r"a\.zarr: expected groups of Zarr version 3, found no zarr.json"):
        read_recording(tmp_path / "a.zarr")
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(tmp_path / "b.nc")
    (tmp_path / "a.pkl").write_bytes(b"")
    with pytest.raises(RecordingError, match="expected a name ending in"):
        read_recording(tmp_path / "a.pkl")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.drop_vars("theta"), "theta: missing; found"),
        (lambda d: d.drop_attrs(deep=False), "attribute 'stimulus_kind' is missing"),
        (lambda d: d.assign_attrs(body="{}"), "body: expected JSON with J1"),
        (lambda d: d.assign_attrs(period_s="1_000"), "period_s: expected a number, got '1_000'"),
        (lambda d: d.assign(samples=d.samples - 0.5), r"samples: trial 1 states 13115\.5 of 13116"),
        (lambda d: d.assign_attrs(stimulus_kind="tilt"), "stimulus_kind: expected one of"),
        (lambda d: d.assign_attrs(rate_hz=99.0), "rate_hz: stated 99 Hz, but the time column has 100"),
        (lambda d: d.assign_coords(angle=["theta2", "theta1"]), "angle: expected theta1, theta2"),
        (lambda d: d.assign(theta=d.theta.astype(str)), "theta: expected numbers"),
        (lambda d: d.assign(theta=d.theta.drop_attrs()), "theta: unit: expected one of rad"),
    ],
)
def test_a_bad_dataset_gets_one_clear_line(
    tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], message: str
) -> None:
    path = tmp_path / "a.nc"
    change(to_dataset(SWAY)).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(RecordingError, match=message):
        read_recording(path)


def _equal(a: Recording, b: Recording) -> None:
    assert replace(a, trials=b.trials) == b
    for one, other in zip(a.trials, b.trials, strict=True):
        assert one.amplitude == other.amplitude
        assert one.stimulus.tobytes() == other.stimulus.tobytes()
        assert one.theta.tobytes() == other.theta.tobytes()


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d,
        lambda d: d.isel(trial=0, drop=True).drop_vars(("samples", "amplitude")),
        lambda d: d.transpose("angle", "time", "trial"),
        lambda d: d.astype("f4"),
        lambda d: d.drop_vars(("angle", "time", "trial")),
    ],
    ids=["as written", "one trial", "transposed", "single precision", "no coordinates"],
)
def test_a_netcdf_file_is_read_without_xarray_as_with_it(
    tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.nc"
    change(to_dataset(SWAY)).to_netcdf(path, engine="h5netcdf")
    monkeypatch.setattr(netcdf_zarr, "answer", by_xarray)
    expected = read_dataset(path)
    monkeypatch.setattr(netcdf_zarr, "answer", without_xarray)
    _equal(read_dataset(path), expected)


@pytest.mark.parametrize(
    "encoding", [{"dtype": "i2", "scale_factor": 1e-5, "_FillValue": -(2**15)}, {"dtype": "f8", "_FillValue": -999.0}]
)
def test_packed_numbers_and_other_marks_of_missing_ones_are_decoded(tmp_path: Path, encoding: dict[str, Any]) -> None:
    path = tmp_path / "a.nc"
    dataset = to_dataset(SWAY)
    dataset.to_netcdf(path, engine="h5netcdf", encoding={"theta": encoding})
    (found, *_), (trial, *_) = read_dataset(path).trials, SWAY.trials
    np.testing.assert_allclose(found.theta, trial.theta, atol=6e-6)


def by_xarray(function: str, *asked: Any, **options: Any) -> Answer:
    return answer(function.replace("formats.hdf5", "formats.packed_netcdf"), *asked, **options)


def without_xarray(function: str, *asked: Any, **options: Any) -> Answer:
    assert "packed_netcdf" not in function
    return answer(function, *asked, **options)


def test_every_function_that_takes_a_path_takes_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a.nc", "a.zarr", "a"):
        assert str(read_recording(str(write_recording(SWAY, name)), data="a" if name == "a" else None)).startswith(
            "Rec"
        )
    write_netcdf(SWAY, "b.nc")
    write_zarr(SWAY, "b.zarr")
    check_zarr("b.zarr")
    regular("b.nc")
    for name in ("b.nc", "b.zarr"):
        assert read_dataset(name).cycles == (3,)
    sheet_path = write_csv(SWAY, "b")
    assert isinstance(read_sheet(str(sheet_path), "b"), Recording)
    assert text.source(Path("b/trial1.csv"), Dialect()).numbered[0] == "time"
    assert inside("b", "trial1.csv", "b.toml").is_file()


def test_what_is_not_a_recording_is_told_what_one_is_and_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text("[study]\nname = 'x'\nseed = 1\n")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "rec.nc").touch()
    (tmp_path / "notes.txt").touch()
    for cube in ("cube", "cube.zarr"):
        (tmp_path / cube).mkdir()
        (tmp_path / cube / "zarr.json").write_text('{"attributes": {"schema": "mcstudy:study_cube:1.0.0"}}')
    for name, what in (
        ("study.toml", "a study file"),
        ("folder", r"a folder with rec\.nc"),
        ("notes.txt", r"expected a name ending in .*\.csv"),
        ("cube", "a results cube"),
        ("cube.zarr", "a results cube"),
    ):
        with pytest.raises(RecordingError, match=f"{what}.*; expected a recording .*mcstudy import.* simulate"):
            read_recording(tmp_path / name)


@pytest.mark.parametrize("given", ["rec.nc", "rec.zarr", "rec"])
def test_a_recording_without_a_name_has_that_of_its_file(tmp_path: Path, given: str) -> None:
    for name, expected in (("simulated", "rec"), ("recording", "rec"), ("subject 1", "subject 1")):
        path = write_recording(replace(SWAY, name=name), tmp_path / given)
        assert read_recording(path).name == expected
        shutil.rmtree(tmp_path / given) if (tmp_path / given).is_dir() else path.unlink()


def test_a_recording_shows_itself_in_a_few_lines() -> None:
    odd = replace(checked_recording(changed(stuck_sensor)).recording, provenance="long " * 1000)
    for shown in (odd, odd.trials[0]):
        assert len(repr(shown)) < 2000
        assert shown._repr_html_().count("<tr>") == len(shown.facts())
    assert "is constant for" in repr(odd)
    assert "ankle_torque" in repr(odd)


def test_a_header_that_claims_terabytes_is_refused_before_reading(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    write_recording(SWAY, store)
    for name, shape in (("stimulus", (1, 10**12)), ("theta", (1, 10**12, 2)), ("time", (10**12,))):
        header = store / name / "zarr.json"
        header.write_text(json.dumps(json.loads(header.read_text()) | {"shape": shape}))
    with pytest.raises(RecordingError, match="stimulus: declares 8000000000000 bytes"):
        read_recording(store)


FREQUENCIES = (0.1, 0.2, 0.5, 1.0)


def published(folder: Path, lines: Iterable[str], head: str = 'units = {angle = "deg"}') -> FrfRecording:
    """The recording of a table of responses whose lines these are."""
    (folder / "frf.csv").write_text("\n".join(lines) + "\n")
    path = folder / "frf.toml"
    path.write_text(f'{head}\nbody = {{reference = "goodworth2018"}}\nfrf = {{file = "frf.csv"}}\n')
    recording = read_recording(path)
    assert isinstance(recording, FrfRecording)
    return recording


def test_a_published_frf_is_a_recording_too(tmp_path: Path) -> None:
    recording = published(tmp_path, ["f,gain1,phase1,sd1", *(f"{f},{0.1 / f},-{30 * f},0.01" for f in FREQUENCIES)])
    assert recording.single
    assert len(repr(recording)) < 2000
    assert "4, 0.1 to 1 Hz" in recording._repr_html_()
    assert recording.base_model().name == "one_segment"
    np.testing.assert_allclose(np.abs(recording.y[:, 0]), np.deg2rad([1, 0.5, 0.2, 0.1]))
    np.testing.assert_allclose(recording.C[:, 0, 0].real, np.deg2rad(0.01) ** 2)
    with pytest.raises(RecordingError, match="column 'sd1' is missing"):
        published(tmp_path, ["f,gain1,phase1", "0.1,1,2"])


def test_rows_of_a_published_frf_may_be_in_any_order_but_not_there_twice(tmp_path: Path) -> None:
    header, *rows = ["f,gain1,phase1,sd1", *(f"{f},{0.1 / f},{-30 * f},{0.01 * f}" for f in FREQUENCIES)]
    first, *others = (
        published(tmp_path, [header, *(rows[k] for k in order)]) for order in ((0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1))
    )
    assert all((r.y == first.y).all() and (r.C == first.C).all() for r in others)
    with pytest.raises(RecordingError, match=r"expected increasing frequencies, got 0.2 Hz after 0.2 Hz"):
        published(tmp_path, [header, *rows, rows[1]])


def test_a_published_response_in_two_forms_must_be_one(tmp_path: Path) -> None:
    f = np.array(FREQUENCIES)
    y = 0.1 / f * np.exp(-1j * f)

    def lines(sign: int) -> list[str]:
        rows = np.column_stack([f, np.abs(y), np.rad2deg(np.angle(y)), y.real, sign * y.imag, 0.01 + 0 * f]).round(4)
        return ["f,gain1,phase1,re1,im1,sd1", *(",".join(map(str, row)) for row in rows.tolist())]

    np.testing.assert_allclose(published(tmp_path, lines(1)).y[:, 0], y * np.pi / 180, atol=1e-5)
    with pytest.raises(RecordingError, match=r"re1, im1 and gain1, phase1 contradict each other at f = 0\.1 Hz"):
        published(tmp_path, lines(-1))
    with pytest.raises(RecordingError, match=r"column 'f' \(Hz\) is missing; found Frequency, Gain1"):
        published(tmp_path, ["Frequency,Gain1", "0.1,1", "0.2,1"])


def test_the_frf_of_a_tilt_is_read_in_the_units_of_both_angles(tmp_path: Path) -> None:
    lines, tilt = ["f,gain1,phase1,sd1", *(f"{f},1.5,-10,0.1" for f in FREQUENCIES)], 'stimulus = "surface_tilt"'
    for units, gain in (('{angle = "deg", stimulus = "deg"}', 1.5), ('{angle = "mrad", stimulus = "rad"}', 1.5e-3)):
        recording = published(tmp_path, lines, f"{tilt}\nunits = {units}")
        assert np.abs(recording.y[:, 0]) == pytest.approx(gain)
        assert recording.base_model().names == ("K", "B", "Kpas", "Td", "Wprop")
    with pytest.raises(RecordingError, match="units: expected both angle and stimulus"):
        published(tmp_path, lines, f'{tilt}\nunits = {{angle = "deg"}}')
    with pytest.raises(RecordingError, match="stimulus: expected one of ankle_torque, surface_tilt, visual_tilt where"):
        published(tmp_path, lines, 'stimulus = "hip_torque"')


def test_a_tilt_and_its_stated_amplitude_are_read_in_their_unit(tmp_path: Path) -> None:
    t = np.arange(0, 30, 0.01)
    table = np.column_stack([0.5 * np.sin(t), 0.5 * np.cos(t), 0.1 * np.sin(t)])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="stimulus,theta1,theta2", comments="")
    text = 'stimulus = "surface_tilt"\nrate_hz = 100\nbody = {reference = "goodworth2018"}\n'
    trials = '[[trials]]\nfile = "a.csv"\namplitude = 0.5\n'
    path = tmp_path / "a.toml"
    path.write_text(f'{text}units = {{angle = "deg", stimulus = "deg"}}\n{trials}')
    recording = read_recording(path)
    assert isinstance(recording, Recording)
    assert recording.trials[0].amplitude == pytest.approx(np.deg2rad(0.5))
    assert recording.amplitudes == pytest.approx(np.deg2rad(0.5), rel=1e-4)
    path.write_text(f'{text}units = {{angle = "deg", stimulus = "rad"}}\n{trials}')
    with pytest.raises(RecordingError, match=r"expected a number from 1e-06 to 0\.4 rad, got 0\.5"):
        read_recording(path)


WANG = Path(__file__).parents[3] / "shared" / "real" / "wang"

WANG_SHEET = """
name = "one person on a translating platform"
rate_hz = 100
stimulus = "platform_translation"
units = {angle = "deg"}
body = {file = "Para_Winter_Subj05.txt", order = ["L1", "h1", "h2", "m1", "m2", "I1", "I2"]}
[[trials]]
time = {file = "Sway0003.txt", column = 0}
stimulus = {file = "Sway0003.txt", column = 1}
theta1 = {file = "JointsGF0003.txt", column = 1}
theta2 = {file = "JointsGF0003.txt", column = 2}
"""


@pytest.mark.skipif(not WANG.is_dir(), reason="the recording of Wang & van den Bogert is not in ../shared/real/wang")
def test_a_real_person_on_a_platform_is_read_and_plausible(tmp_path: Path) -> None:
    path = tmp_path / "wang.toml"
    path.write_text(WANG_SHEET)
    recording = read_recording(path, data=WANG)
    assert isinstance(recording, Recording)
    assert recording.period_s is None
    assert recording.suspicions == ()
    assert recording.trials[0].samples == 31002
    assert recording.amplitudes[0] == pytest.approx(0.05, rel=0.02)
    assert recording.body.mgh == pytest.approx(661, rel=0.01)
