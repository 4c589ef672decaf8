"""One sway angle from what laboratories record: the angle of the simulated person comes back, whatever was written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sway_files import CYCLES, HEIGHT, PERIOD, PERSON, RATE, Sway, person_constants, simulated, write_table

from mcstudy.recordings.io import read_recording, write_recording
from mcstudy.recordings.laboratory_import import Imported, import_files
from mcstudy.stance.anthropometry import centre_of_mass, segments
from mcstudy.stance.body import Body

SHARED = Path(__file__).parents[3] / "shared" / "layouts"

ANKLE, HIP, SHOULDER = 0.039 * HEIGHT, 0.530 * HEIGHT, 0.818 * HEIGHT
"""Heights above the floor by Drillis & Contini (1966), m."""

HEADSET = {
    "model": "independent_channel_visual",
    "channels": {"stimulus": {"column": "stim_pitch", "unit": "deg"}},
    "markers": {
        "hip": ["hip"],
        "shoulder": ["shld"],
        "columns": "{marker}_{axis}pos",
        "forward": "+z",
        "up": "+y",
        "unit": "m",
    },
    "resample_hz": 90,
    "body": PERSON,
}


@pytest.fixture(scope="module")
def truth() -> Sway:
    return simulated()


def imported(path: Path, **options: Any) -> Imported:
    return import_files([path], None, {"model": "independent_channel", "body": PERSON, **options})


def recovered(found: Imported) -> np.ndarray:
    """The sway, rad, about its mean."""
    theta = found.recording.trials[0].theta[:, 0]
    return np.asarray(theta - theta.mean())


def decibels(error: np.ndarray, signal: np.ndarray) -> float:
    return float(20 * np.log10(np.std(error) / np.std(signal)))


@pytest.mark.parametrize(("unit", "per_metre"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_a_displacement_of_the_centre_of_mass_is_an_angle(
    tmp_path: Path, truth: Sway, unit: str, per_metre: float
) -> None:
    com = 0.95 * np.sin(truth.sway) + 0.3  # the origin of the laboratory is anywhere
    path = write_table(tmp_path / "a.csv", {"tilt (deg)": np.rad2deg(truth.tilt), f"COM ({unit})": per_metre * com})
    found = imported(
        path, rate_hz=RATE, channels={"stimulus": "tilt", "sway": {"column": "COM", "of": "com", "height": 0.95}}
    )
    assert np.abs(recovered(found) - (truth.sway - truth.sway.mean())).max() < 2e-5
    assert "h = 0.950 m above the axis" in found.text()


def test_its_height_is_that_of_the_body_where_none_is_stated(tmp_path: Path, truth: Sway) -> None:
    s = segments(HEIGHT, PERSON["weight"])
    height = (s["m1"] * s["h1"] + s["m2"] * (s["L1"] + s["h2"])) / (s["m1"] + s["m2"])
    path = write_table(tmp_path / "a.csv", {"tilt_deg": np.rad2deg(truth.tilt), "COM": height * np.sin(truth.sway)})
    sway = {"column": "COM", "unit": "m", "of": "com"}
    found = imported(path, rate_hz=RATE, channels={"stimulus": "tilt_deg", "sway": sway})
    assert np.abs(recovered(found) - (truth.sway - truth.sway.mean())).max() < 2e-5


def test_a_centre_of_pressure_gives_the_sway_of_one_segment(tmp_path: Path, truth: Sway) -> None:
    """x - J/(mgh) x'', with the derivative of the truth by its spectrum."""
    c = person_constants()
    x = c["h"] * truth.sway
    last = slice(-round(PERIOD * RATE), None)  # periodic there, so that its derivative is exact
    x = np.tile(x[last], 3)
    omega = 2 * np.pi * np.fft.rfftfreq(x.size, 1 / RATE)
    cop = np.fft.irfft(np.fft.rfft(x) * (1 + c["J"] / c["mgh"] * omega**2), x.size)
    path = write_table(
        tmp_path / "a.csv", {"tilt_deg": np.rad2deg(np.tile(truth.tilt[last], 3)), "COP AP (cm)": 100 * cop}
    )
    found = imported(path, rate_hz=RATE, channels={"stimulus": "tilt_deg", "sway": {"column": "COP AP", "of": "cop"}})
    angle, expected = recovered(found), np.tile(truth.sway[last], 3)
    expected = expected - expected.mean()
    inner = slice(200, -200)  # the ends disturb about a second
    assert decibels((angle - expected)[inner], expected) < -60
    assert "sways as one segment" in found.text()


def headset(folder: Path, truth: Sway, stamps: np.ndarray, name: str = "headset.csv") -> Path:
    """A headset's file at stamps (n,), s: trackers in m, rotations from 0 to 360, columns that nobody uses."""
    from scipy.interpolate import CubicSpline

    tilt, sway = (CubicSpline(truth.time, x)(stamps) for x in (truth.tilt, truth.sway))
    still = np.zeros(stamps.size)
    columns = {"time": stamps, "stim_pitch": np.rad2deg(tilt), "stim_roll": still, "stim_scale": still + 1}
    for name_, height in (("shld", SHOULDER), ("hip", HIP)):
        h = height - ANKLE
        columns |= {
            f"{name_}_xpos": still + 0.1,
            f"{name_}_ypos": ANKLE + h * np.cos(sway),
            f"{name_}_zpos": -0.35 + h * np.sin(sway),
            f"{name_}_xrot": np.rad2deg(sway) % 360,
        }
    return write_table(folder / name, columns)


def jittered(truth: Sway) -> np.ndarray:
    """Stamps near 90 Hz in steps of 1/1024 s, as headsets write them."""
    steps = 1 / 90 + np.random.default_rng(1).choice([-1, 0, 1], round(90 * truth.time[-1])) / 1024
    stamps = np.round(1024 * np.cumsum(steps)) / 1024
    stamps -= stamps[0]
    return np.asarray(stamps[stamps <= truth.time[-1]])


def at(truth: Sway, rate_hz: float, samples: int) -> np.ndarray:
    from scipy.interpolate import CubicSpline

    sway = CubicSpline(truth.time, truth.sway)(np.arange(samples) / rate_hz)
    return np.asarray(sway - sway.mean())


def test_a_headset_with_a_jittering_clock_gives_the_sway_of_the_centre_of_mass(tmp_path: Path, truth: Sway) -> None:
    found = import_files([headset(tmp_path, truth, jittered(truth))], None, HEADSET)
    angle = recovered(found)
    assert found.recording.rate_hz == 90
    assert decibels(angle - at(truth, 90, angle.size), angle) < -70
    text = found.text()
    assert "x = 0.450 hip + 0.437 shoulder" in text
    assert "stamps deviate by up to" in text
    assert "Winter (2009), Table 4.1" in text


def test_without_a_rate_to_resample_to_a_jittering_clock_is_refused_with_the_way_on(
    tmp_path: Path, truth: Sway
) -> None:
    from mcstudy.errors import RecordingError

    path = headset(tmp_path, truth, jittered(truth))
    with pytest.raises(RecordingError, match=r"their SD is .* s, .*--resample"):
        import_files([path], None, {k: v for k, v in HEADSET.items() if k != "resample_hz"})


def test_a_rotation_from_0_to_360_is_unwrapped(tmp_path: Path, truth: Sway) -> None:
    path = headset(tmp_path, truth, jittered(truth))
    channels = {**HEADSET["channels"], "sway": {"column": "hip_xrot", "unit": "deg"}}  # type: ignore[dict-item]
    found = import_files([path], None, {**HEADSET, "markers": None, "channels": channels})
    angle = recovered(found)
    assert decibels(angle - at(truth, 90, angle.size), angle) < -100
    assert "steps from 360 to 0 deg taken out" in found.text()


def test_rows_that_were_written_twice_are_averaged_and_told(tmp_path: Path, truth: Sway) -> None:
    stamps = jittered(truth)
    twice = np.sort(np.concatenate([stamps, stamps[100:5000:100]]))
    found = import_files([headset(tmp_path, truth, twice)], None, HEADSET)
    angle = recovered(found)
    assert decibels(angle - at(truth, 90, angle.size), angle) < -70
    assert "49 rows repeat the time stamp" in found.text()


def test_the_centre_of_mass_of_two_places_is_the_sum_over_segments() -> None:
    """A body with its hip at an angle: legs and upper body weighted with their masses, by hand."""
    s = segments(1.8, 80.0)
    leg, trunk, table = 0.02, 0.05, 0.288 * 1.8
    x_hip = s["L1"] * leg
    x_shoulder = x_hip + table * trunk
    direct = (s["m1"] * s["h1"] * leg + s["m2"] * (x_hip + s["h2"] * trunk)) / (s["m1"] + s["m2"])
    u, v = centre_of_mass(s, table)
    assert u * x_hip + v * x_shoulder == pytest.approx(direct, rel=1e-12)


def test_a_rigid_body_has_one_angle_at_every_height(tmp_path: Path, truth: Sway) -> None:
    """Sway rods, of which only the displacement is known, in a file with semicolons and decimal commas."""
    columns = {
        "Surface pos (deg)": np.rad2deg(truth.tilt),
        "Hip rod (cm)": 100 * (1.00 - ANKLE) * np.sin(truth.sway),
        "Shoulder rod (cm)": 100 * (1.45 - ANKLE) * np.sin(truth.sway),
    }
    path = write_table(tmp_path / "rods.csv", columns, ";", ",")
    rods = {"hip": ["Hip rod"], "shoulder": ["Shoulder rod"], "columns": "{marker}"}
    heights = {"hip": 1.00, "shoulder": 1.45}
    for angle in ("com", "legs", "trunk"):
        found = imported(
            path,
            rate_hz=RATE,
            channels={"stimulus": "Surface pos"},
            markers={**rods, "heights": heights, "angle": angle},
        )
        assert np.abs(recovered(found) - (truth.sway - truth.sway.mean())).max() < 2e-5


MOCAP = """Trajectories
100
,,S:LANK,,,S:LKNE,,,S:LHIP,,,S:LSHO,,,S:C7,,,S:HEAD,,,S:PLAT1,,
Frame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z,X,Y,Z,X,Y,Z,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm,mm
"""
"""Lines above the numbers of an optical export."""


def mocap(path: Path, truth: Sway, lost: slice = slice(300, 305), lever: float = 0.4) -> Path:
    """An optical export, mm: a marker that is lost for some frames, one on the platform, a lever ahead of its axis."""
    n = truth.time.size
    places = {
        "ANK": 0.0,
        "KNE": 0.285 * HEIGHT - ANKLE,
        "HIP": HIP - ANKLE,
        "SHO": SHOULDER - ANKLE,
        "C7": 1.4,
        "HEAD": 1.6,
    }
    cells = [np.arange(1, n + 1), np.zeros(n)]
    for height in places.values():
        cells += [
            412 + 1e3 * height * np.sin(truth.sway),
            np.full(n, 88.0),
            1e3 * (ANKLE + height * np.cos(truth.sway)),
        ]
    cells += [np.full(n, 500.0), np.zeros(n), 12 + 1e3 * lever * np.sin(truth.tilt)]
    table = np.column_stack(cells)
    table[lost, 8:11] = np.nan
    rows = (",".join("" if np.isnan(x) else f"{x:.7g}" for x in row) for row in table.tolist())
    path.write_text(MOCAP + "\n".join(rows) + "\n", encoding="utf-8")
    return path


OPTICAL = {
    "channels": {"stimulus": {"column": "S:PLAT1.z", "height": 0.4}},
    "markers": {"ankle": ["S:LANK"], "hip": ["S:LHIP"], "shoulder": ["S:LSHO"], "forward": "+x", "up": "+z"},
}


def test_an_optical_export_gives_tilt_and_sway_with_its_own_rate_and_short_gaps_filled(
    tmp_path: Path, truth: Sway
) -> None:
    found = imported(mocap(tmp_path / "m.csv", truth), **OPTICAL, fill_gaps_s=0.1)
    (trial,) = found.recording.trials
    assert found.recording.rate_hz == 100
    angle = recovered(found)
    assert decibels(angle - (truth.sway - truth.sway.mean()), angle) < -60
    tilt = truth.tilt - truth.tilt.mean()
    assert decibels(trial.stimulus - tilt, tilt) < -60


def test_lost_markers_are_refused_unless_gaps_are_declared(tmp_path: Path, truth: Sway) -> None:
    from mcstudy.errors import RecordingError

    with pytest.raises(RecordingError, match=r"5 of \d+ values are missing; a gap of 0.05 s at t = 3 s"):
        imported(mocap(tmp_path / "m.csv", truth), **OPTICAL)
    with pytest.raises(RecordingError, match=r"a gap of 2 s at t = 3 s is not filled"):
        imported(mocap(tmp_path / "m.csv", truth, slice(300, 500)), **OPTICAL, fill_gaps_s=0.1)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the layouts of laboratories are not here (../shared/layouts)")
@pytest.mark.parametrize("name", ["headset.csv", "swayrod.csv", "mocap.csv"])
def test_the_layouts_of_laboratories_are_read(tmp_path: Path, truth: Sway, name: str) -> None:
    """Their own lines above the numbers and their own first row, which is repeated with the simulated person in it."""
    text = (SHARED / name).read_text(encoding="utf-8").splitlines()
    delimiter = ";" if name == "swayrod.csv" else ","
    first = next(k for k, line in enumerate(text) if line[:1].isdigit() and line.count(delimiter) > 3)
    row, head = text[first].split(delimiter), text[:first]
    names = head[-1].split(delimiter) if name != "mocap.csv" else []
    com = 100 * person_constants()["h"] * np.sin(truth.sway)
    lines = []
    for k, t in enumerate(truth.time):
        cells, (tilt, sway) = list(row), (truth.tilt[k], truth.sway[k])
        if name == "headset.csv":
            values = {"time": t, "stim_pitch": np.rad2deg(tilt)}
            values |= {"shld_zpos": (SHOULDER - ANKLE) * np.sin(sway), "shld_ypos": SHOULDER}
            values |= {"hip_zpos": (HIP - ANKLE) * np.sin(sway), "hip_ypos": HIP}
        elif name == "swayrod.csv":
            values = {"Time (s)": t, "Surface pos (deg)": np.rad2deg(tilt), "COM AP (cm)": com[k]}
        else:
            values = {}
            for at_x, height in ((2, 0.0), (8, HIP - ANKLE), (11, SHOULDER - ANKLE)):
                cells[at_x] = f"{400 + 1e3 * height * np.sin(sway):.6f}"
                cells[at_x + 2] = f"{1e3 * (ANKLE + height):.6f}"
            cells[0], cells[22] = str(k + 1), f"{400 * np.sin(tilt):.6f}"
        for column, value in values.items():
            cells[names.index(column)] = f"{value:.9f}"
        lines.append(delimiter.join(cells))
    path = tmp_path / name
    path.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")
    found = {
        "headset.csv": lambda: import_files([path], None, {**HEADSET, "resample_hz": None}),
        "swayrod.csv": lambda: imported(
            path, channels={"stimulus": "Surface pos", "sway": {"column": "COM AP", "of": "com"}}
        ),
        "mocap.csv": lambda: imported(path, **OPTICAL),
    }[name]()
    angle = recovered(found)
    assert np.abs(angle - (truth.sway - truth.sway.mean())).max() < 5e-5


def test_the_body_of_the_person_is_the_models(tmp_path: Path, truth: Sway) -> None:
    """By hand: J and m g h of legs and upper body with straight hips, and gains in proportion to m g h."""
    path = write_table(tmp_path / "a.csv", {"tilt_deg": np.rad2deg(truth.tilt), "sway_deg": np.rad2deg(truth.sway)})
    found = imported(path, rate_hz=RATE, channels={"stimulus": "tilt_deg", "sway": "sway_deg"})
    body = Body.from_person(**PERSON)
    model = found.recording.model
    assert model is not None
    inertia, gravity = (next(t.coefficient for t in model.terms if t.order == k and not t.gain) for k in (2, 0))
    assert inertia == pytest.approx(body.J1 + body.C2, rel=1e-12)
    assert gravity == pytest.approx(-body.mgh, rel=1e-12)
    values = {p.name: p for p in model.parameters}
    ratio = body.mgh / (75 * 9.81 * 0.83)
    assert values["Kp"].value == pytest.approx(943.9 * ratio)
    assert values["Kp"].upper == pytest.approx(2 * 943.9 * ratio)
    assert values["Kf"].value == pytest.approx(0.0018 / ratio)
    assert values["tau"].value == 0.097


def test_the_body_by_the_table_is_that_of_the_segments_written_out() -> None:
    """80 kg, 1.80 m, shank and thigh apart: mgh and J of a rigid body by summing over its parts."""
    M, H, g = 80.0, 1.80, 9.81
    parts = [
        (2 * 0.0465 * M, (1 - 0.433) * 0.246 * H, 0.302 * 0.246 * H),
        (2 * 0.1 * M, (0.246 + (1 - 0.433) * 0.245) * H, 0.323 * 0.245 * H),
        (0.678 * M, (0.491 + 0.626 * 0.288) * H, 0.496 * 0.288 * H),
    ]
    body = Body.from_person(height=H, weight=M)
    assert body.mgh == pytest.approx(g * sum(m * h for m, h, _ in parts), rel=1e-12)
    inertia = body.J1 + body.C2
    assert inertia == pytest.approx(sum(m * (h**2 + r**2) for m, h, r in parts), rel=1e-12)


@pytest.mark.parametrize("ending", [".nc", ".zarr", ""])
def test_a_recording_keeps_the_constants_of_its_person(tmp_path: Path, truth: Sway, ending: str) -> None:
    path = write_table(tmp_path / "a.csv", {"tilt_deg": np.rad2deg(truth.tilt), "sway_deg": np.rad2deg(truth.sway)})
    recording = imported(path, rate_hz=RATE, channels={"stimulus": "tilt_deg", "sway": "sway_deg"}).recording
    written = write_recording(recording, tmp_path / f"rec{ending}")
    again = read_recording(written)
    assert dict(again.constants) == pytest.approx({k: v for k, v in person_constants().items() if k in ("J", "mgh")})
    other = read_recording(written, model="independent_channel_visual").model
    assert other is not None
    assert again.model is not None
    assert [p.name for p in other.parameters if p.name == "Wv"] == ["Wv"]
    of = [next(t.coefficient for t in m.terms if t.order == 2) for m in (other, again.model)]
    assert of[0] == pytest.approx(of[1])


def test_the_period_is_found_in_the_stimulus_and_said(tmp_path: Path, truth: Sway) -> None:
    path = write_table(tmp_path / "a.csv", {"tilt_deg": np.rad2deg(truth.tilt), "sway_deg": np.rad2deg(truth.sway)})
    found = imported(path, rate_hz=RATE, channels={"stimulus": "tilt_deg", "sway": "sway_deg"})
    assert found.recording.period_s == PERIOD
    assert found.recording.cycles == (CYCLES,)
    assert "PRTS of 80 states of 0.25 s (base 3, order 4), odd harmonics only; 2 deg from peak to peak" in found.text()


def test_rest_before_the_first_cycle_is_cut_where_the_period_is_found(tmp_path: Path, truth: Sway) -> None:
    quiet = 1250
    tilt, sway = (np.concatenate([np.full(quiet, x[0]), x]) for x in (truth.tilt, truth.sway))
    path = write_table(tmp_path / "a.csv", {"tilt_deg": np.rad2deg(tilt), "sway_deg": np.rad2deg(sway)})
    found = imported(path, rate_hz=RATE, channels={"stimulus": "tilt_deg", "sway": "sway_deg"})
    (trial,) = found.recording.trials
    assert found.recording.cycles == (CYCLES,)
    assert "trial 1: only 12.5 to 112.5 s is used" in found.text()
    np.testing.assert_allclose(trial.stimulus[-500:], truth.tilt[-500:], atol=1e-10)
