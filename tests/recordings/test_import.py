"""The same recording in every format of a laboratory is the same recording; mistakes get one line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from c3d_writer import write_c3d
from lab_files import write_mat73
from scipy.io import savemat

from mcstudy import Body, fit
from mcstudy.cli import main
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.recordings.formats import open_source
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.laboratory_import import import_files
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.stimulus import Prts

RATE, AMPLITUDES = 100.0, (3.0, 5.0)

PERSON = {"height": 1.80, "weight": 75.0}

STATED = {"rate_hz": RATE, "units": {"angle": "deg", "stimulus": "N m"}, "body": PERSON}


@pytest.fixture(scope="module")
def truth() -> Recording:
    protocol = Protocol(waveform=Prts(stages=5, rate_hz=RATE), amplitudes=AMPLITUDES, cycles=4)
    return simulate_recording(protocol, two_segment().truth, np.random.default_rng(0))


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory, truth: Recording) -> Path:
    """The recording in every format, one trial per file and all in one, angles in deg, the trunk in space."""
    folder = tmp_path_factory.mktemp("lab")
    torque = np.array([t.stimulus for t in truth.trials])
    leg = np.rad2deg([t.theta[:, 0] for t in truth.trials])
    trunk = np.rad2deg([t.theta.sum(axis=1) for t in truth.trials])
    elements = [{"torque": u, "angles": np.column_stack([a, b])} for u, a, b in zip(torque, leg, trunk, strict=True)]
    columns = {"torque": torque.T, "kin": {"leg": leg.T, "trunk": trunk.T, "who": "S01"}}
    for compressed in (False, True):
        savemat(folder / f"columns{'_z' * compressed}.mat", columns, do_compression=compressed)
    array = np.empty((1, len(elements)), dtype=[("torque", object), ("angles", object)])
    for k, e in enumerate(elements):
        array[0, k] = (e["torque"][None], e["angles"])
    savemat(folder / "elements.mat", {"trial": array})
    write_mat73(folder / "columns73.mat", columns)
    write_mat73(folder / "elements73.mat", {"trial": elements})
    write_mat73(folder / "cells73.mat", {"u": list(torque), "a": list(leg), "b": list(trunk)})
    cells = {n: np.empty((1, len(v)), object) for n, v in (("u", torque), ("a", leg), ("b", trunk))}
    for name, values in (("u", torque), ("a", leg), ("b", trunk)):
        for k, v in enumerate(values):
            cells[name][0, k] = v
    savemat(folder / "cells.mat", cells)
    for k, (u, a, b) in enumerate(zip(torque, leg, trunk, strict=True), start=1):
        time = np.arange(u.size) / RATE
        np.savetxt(
            folder / f"{k}.txt", np.column_stack([time, u, a, b]), "%.12g", "\t", header="t\tu\ta\tb", comments=""
        )
        lines = ["Laboratory 1", "subject;S01", "Zeit;Moment;Bein;Rumpf", "(s);(N m);(°);(°)"]
        lines += [";".join(f"{v:.12g}".replace(".", ",") for v in row) for row in zip(time, u, a, b, strict=True)]
        (folder / f"{k}.csv").write_bytes("\r\n".join(lines).encode("cp1252"))
        (folder / f"{k}.tsv").write_text(
            "torque (N mm)\ttheta1 [deg]\ttheta2 [deg]\n"
            + "\n".join(f"{1e3 * x:.12g}\t{y:.12g}\t{z:.12g}" for x, y, z in zip(u, a, b, strict=True)),
            encoding="utf-16",
        )
        zeros = np.zeros(u.size)
        angles = {"Leg": np.column_stack([a, zeros, zeros]), "Trunk": np.column_stack([b, zeros, zeros])}
        write_c3d(folder / f"{k}.c3d", angles, {"Torque": u}, RATE, angles=list(angles), analog_units=["N m"])
    return folder


def channels(stimulus: Any, theta1: Any, theta2: Any) -> dict[str, Any]:
    return {"stimulus": stimulus, "theta1": theta1, "theta2": theta2}


MAT_COLUMNS = {**STATED, "channels": channels("torque", "kin.leg", "kin.trunk"), "split": {"by": "columns"}}
MAT_ELEMENTS = {
    **STATED,
    "channels": channels("trial.torque", "trial.angles[:,0]", "trial.angles[:,1]"),
    "split": {"by": "elements"},
}
CELLS = {**STATED, "channels": channels("u", "a", "b"), "split": {"by": "elements"}}
GERMAN = {
    "channels": channels("Moment", "Bein", "Rumpf") | {"time": "Zeit"},
    "text": {"decimal": ",", "skip": 2},
    "units": {"angle": "deg", "stimulus": "N m"},
    "body": PERSON,
}
BARE = {**STATED, "channels": channels("u", "a", "b")}
UNITS_IN_NAMES = {
    "rate_hz": RATE,
    "channels": {"stimulus": "torque"},
    "units": {"angle": "deg", "stimulus": "N mm"},
    "body": PERSON,
}
C3D = {
    "channels": channels("Torque", "Leg.x", "Trunk.x"),
    "body": PERSON,
}
FORMATS: dict[str, tuple[tuple[str, ...], dict[str, Any], float]] = {
    "MATLAB 5": (("columns.mat",), MAT_COLUMNS, 1e-12),
    "MATLAB 5, compressed": (("columns_z.mat",), MAT_COLUMNS, 1e-12),
    "MATLAB 5, struct array": (("elements.mat",), MAT_ELEMENTS, 1e-12),
    "MATLAB 7.3, struct array": (("elements73.mat",), MAT_ELEMENTS, 1e-12),
    "MATLAB 5, cells": (("cells.mat",), CELLS, 1e-12),
    "MATLAB 7.3": (("columns73.mat",), MAT_COLUMNS, 1e-12),
    "MATLAB 7.3, cells": (("cells73.mat",), CELLS, 1e-12),
    "tab": (("1.txt", "2.txt"), BARE, 1e-10),
    "decimal comma": (("1.csv", "2.csv"), GERMAN, 1e-10),
    "UTF-16, N mm": (("1.tsv", "2.tsv"), UNITS_IN_NAMES, 1e-10),
    "C3D": (("1.c3d", "2.c3d"), C3D, 1e-6),
}
"""Files, description and largest difference relative to the largest value; C3D holds numbers of 32 bits."""


def same(one: Recording, other: Recording, tolerance: float) -> None:
    assert one.rate_hz == other.rate_hz
    assert len(one.trials) == len(other.trials)
    for a, b in zip(one.trials, other.trials, strict=True):
        for x, y in ((a.stimulus, b.stimulus), (a.theta, b.theta)):
            np.testing.assert_allclose(x, y, rtol=0, atol=tolerance * np.abs(y).max())


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_recording(lab: Path, truth: Recording, name: str) -> None:
    files, described, tolerance = FORMATS[name]
    found = import_files([lab / f for f in files], None, {**described, "upper_body": "space"})
    same(found.recording, truth, tolerance)
    assert "by Winter (2009), Table 4.1" in found.recording.provenance


def said(capsys: pytest.CaptureFixture[str]) -> str:
    out, err = capsys.readouterr()
    assert err.count("\n") <= 1
    return out + err


OPTIONS = {
    "--stimulus": "Torque",
    "--theta1": "Leg.x",
    "--theta2": "Trunk.x",
    "--upper-body": "space",
    "--height": "1.80",
    "--weight": "75",
}


def test_the_command_writes_what_fit_and_diagnose_read_and_tells_what_it_read(
    lab: Path, truth: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "subject1.nc"
    period = truth.period_s
    words = [word for option in (OPTIONS | {"--period": str(period)}).items() for word in option]
    assert main(["import", str(lab / "1.c3d"), str(lab / "2.c3d"), "-o", str(out), *words]) == Exit.DONE
    told = said(capsys)
    written = read_recording(out)
    assert isinstance(written, Recording)
    same(written, truth, 1e-6)
    assert written.period_s == period
    row = next(line for line in told.splitlines() if "1.c3d: Torque" in line).split()
    assert row[:2] == ["1", "stimulus"]
    assert row[-5:-3] == ["100", str(truth.trials[0].samples)]
    assert float(row[-3]) == pytest.approx(truth.trials[0].stimulus.std(), rel=1e-2)
    assert float(row[-2]) == pytest.approx(truth.trials[0].peak, rel=1e-2)
    assert "4, 4 whole cycles" in told
    assert "Winter (2009), Table 4.1" in told
    assert "minus theta1" in told
    assert f"written: {out}" in told


def test_a_period_that_is_not_stated_is_found_and_told(lab: Path, truth: Recording) -> None:
    files, described, _ = FORMATS["MATLAB 5"]
    found = import_files([lab / files[0]], None, {**described, "upper_body": "space"})
    assert found.recording.period_s == truth.period_s
    assert "period of 4.84 s found in the stimulus; for another, state it (--period)" in found.text()
    assert "PRTS of 242 states of 0.02 s (base 3, order 5), odd harmonics only" in found.text()


def test_the_variables_of_a_file_are_listed_and_named_when_one_is_missing(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for file, names in {
        "elements.mat": ("trial[0].torque", "trial[1].angles"),
        "elements73.mat": ("trial[0].torque", "trial[1].angles"),
        "columns73.mat": ("torque", "kin.leg", "kin.trunk"),
        "1.c3d": ("Torque", "Leg.x", "Trunk.z"),
        "1.txt": ("t", "u", "a", "b"),
    }.items():
        assert main(["import", "--list", str(lab / file)]) == Exit.DONE
        told = said(capsys)
        assert all(re.search(rf"^{re.escape(name)} ", told, re.MULTILINE) for name in names), told


MISTAKES: dict[str, tuple[dict[str, Any], str]] = {
    "no unit": ({"units": {}}, r"units\.stimulus: expected the unit of stimulus \(--stimulus-unit\)"),
    "no unit of the angles": ({"units": {"stimulus": "N m"}}, r"units\.angle: expected the unit of theta1 \(--unit\)"),
    "an unknown unit": ({"units": {"angle": "grad", "stimulus": "N m"}}, "theta1: unit: expected one of rad"),
    "no body": ({"body": {}}, r"body: expected J1 \.\.\. A2, segments, height and weight"),
    "height in cm": ({"body": {"height": 180.0, "weight": 75.0}}, r"body\.height: .* got 180; is it in m\?"),
    "no rate": ({"rate_hz": None}, "rate_hz: expected a rate or a time column"),
    "a variable that is not there": (
        {"channels": channels("torqe", "kin.leg", "kin.trunk")},
        r"variable 'torqe' is missing \(similar: torque\); found torque, kin\.leg, kin\.trunk",
    ),
    "a matrix without a word on its columns": (
        {"split": {}},
        r"torque: expected one row or column, got \d+ x 2; name a column as torque\[:,0\]",
    ),
    "rows for columns": ({"split": {"by": "rows"}}, "expected at most 1000 trials, got .* is it the other way round"),
    "an index too large": (
        {"channels": channels("torque[:,2]", "kin.leg[:,0]", "kin.trunk[:,0]"), "split": {}},
        "expected indices from 0 within",
    ),
    "theta2 twice": ({"channels": channels("torque", "kin.leg", "kin.leg")}, "theta2: constant"),
    "a period that is not there": ({"period_s": 3.0}, "does not repeat every 3 s .*it repeats every"),
    "starts after the end": ({"split": {"by": "columns", "starts": [1e6]}}, r"split\.starts: expected times from 0 to"),
    "an unknown field": ({"peroid_s": 3.0}, "peroid_s: unknown key"),
    "two delimiters": ({"text": {"delimiter": ";;"}}, "delimiter of one character"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_gets_one_line_that_names_the_field(lab: Path, name: str) -> None:
    changes, message = MISTAKES[name]
    with pytest.raises(InputError, match=message) as caught:
        import_files([lab / "columns.mat"], None, {**MAT_COLUMNS, "upper_body": "space", **changes})
    assert "\n" not in str(caught.value)


def test_fits_of_the_same_recording_in_other_formats_agree_to_rounding(lab: Path, truth: Recording) -> None:
    """Estimates from C3D (32 bits) and MATLAB differ from those of the simulated recording by far less than their
    errors."""
    body = Body.from_person(1.80, 75.0)
    expected = estimates(replace(truth, body=body))
    for name, most in (("MATLAB 7.3", 1e-6), ("C3D", 1e-3)):
        files, described, _ = FORMATS[name]
        options = {**described, "upper_body": "space", "period_s": truth.period_s}
        found = estimates(import_files([lab / f for f in files], None, options).recording)
        for parameter, (value, width) in expected.items():
            assert abs(found[parameter][0] - value) <= most * width, (name, parameter)


def estimates(recording: Recording) -> dict[str, tuple[float, float]]:
    """Estimate and width of the interval of every quantity."""
    result = fit(recording, fmax=1.5)
    return {n: (result[n].estimate, result[n].high - result[n].low) for n in ("K11 + Kpas1", "B11", "Td1")}


MATLABS_OWN = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
"""Files that MATLAB wrote, of versions 5 to 7.4 on several machines; SciPy brings them for its own tests."""


@pytest.mark.skipif(not MATLABS_OWN.is_dir(), reason="this SciPy comes without its test files")
def test_files_that_matlab_wrote_hold_the_numbers_that_scipy_finds_in_them() -> None:
    compared = 0
    for file in sorted(MATLABS_OWN.glob("test*_[5-7].*.mat")):
        if "hdf5" in file.name:
            continue
        found, expected = open_source(file, Dialect()), scipy.io.loadmat(file)
        for name, values in expected.items():
            if isinstance(values, np.ndarray) and values.dtype.kind in "fiu" and values.size:
                np.testing.assert_array_equal(found.pick(name).values, values, f"{file.name}: {name}")
                compared += 1
    assert compared >= 20
    newer = open_source(MATLABS_OWN / "testhdf5_7.4_GLNX86.mat", Dialect())
    assert newer.kind == "MATLAB 7.3"
    np.testing.assert_allclose(newer.pick("testdouble").values[0], np.linspace(0, 2 * np.pi, 9))
