"""Names that are not UTF-8, control characters and byte order marks: nothing breaks, and nothing reaches a terminal."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.errors import InputError, RecordingError
from mcstudy.exits import Exit
from mcstudy.files.delimited import labelled
from mcstudy.identification.people.members import read_people
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording, write_recording
from mcstudy.recordings.laboratory_import import import_files
from mcstudy.recordings.recording import Recording
from mcstudy.text_tables import escaped, fill, folded, table

ESCAPE = "\x1b[2J\x1b]0;x\x07"

OPTIONS = ["--unit", "deg", "--stimulus-unit", "Nm", "--rate", "100", "--height", "1.7", "--weight", "70"]


def rows(header: str = "stimulus,theta1,theta2", footer: str = "") -> str:
    t = np.arange(3000) / 100
    columns = (3 * np.sin(3 * t), 0.5 * np.sin(3 * t - 1), 0.7 * np.sin(4 * t))
    return "\n".join([header, *(",".join(f"{v:.6g}" for v in row) for row in zip(*columns, strict=True)), footer])


def bytes_name(folder: Path, ending: str) -> Path:
    """A name of the year 1990: "übung" in Latin-1, which is not UTF-8."""
    return folder / os.fsdecode(b"\xfcbung" + ending.encode())


def test_a_name_that_is_not_utf_8_is_imported_written_and_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = bytes_name(tmp_path, ".csv")
    file.write_text(rows())
    for ending in (".nc", ".zarr", ""):
        out = bytes_name(tmp_path, ending)
        assert main(["import", str(file), "-o", str(out), *OPTIONS]) == Exit.DONE
        written = out / "recording.toml" if ending == "" else out
        found = read_recording(written)
        assert isinstance(found, Recording)
        assert found.name == "\\udcfcbung"
        assert "\\udcfcbung" in capsys.readouterr().out


def test_a_page_of_a_name_that_is_not_utf_8_is_written(tmp_path: Path) -> None:
    recording = mc.simulate(amplitude=5.0, cycles=4, seed=4)
    page = bytes_name(tmp_path, ".html")
    mc.fit(write_recording(recording, bytes_name(tmp_path, ".nc")), fmax=1.0).to_html(page)
    assert "bung" in page.read_text("utf-8")


def test_the_command_prints_any_name(tmp_path: Path) -> None:
    file = bytes_name(tmp_path, ".csv")
    file.write_text(rows())
    environment = os.environ | {"PYTHONIOENCODING": "utf-8:strict"}
    words = [sys.executable, "-m", "mcstudy", "import", str(file), "-o", str(bytes_name(tmp_path, ".nc")), *OPTIONS]
    ran = subprocess.run(words, capture_output=True, env=environment)
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert b"written: " in ran.stdout


def test_what_is_imported_is_written_before_it_is_printed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    words = [sys.executable, "-m", "mcstudy", "import", str(tmp_path / "a.csv"), "-o", str(tmp_path / "a.nc"), *OPTIONS]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as ran:
        assert ran.stdout is not None
        ran.stdout.close()  # the reader is gone before the first line
        assert ran.wait() == 0
    assert isinstance(read_recording(tmp_path / "a.nc"), Recording)


CONTROLS: dict[str, tuple[str, list[str]]] = {
    "a name": (rows(f"stimulus,{ESCAPE}theta1,theta2"), ["--theta1", f"{ESCAPE}theta1"]),
    "a name that is listed": (rows(f"stimulus,{ESCAPE}theta1,theta2"), ["--list"]),
    "a name that is missing": (rows(f"stimulus,{ESCAPE}theta1,theta2"), []),
    "a name of another direction": (rows("stimulus,theta1\u202e,theta2"), ["--list"]),
    "a cell": (rows().replace("0.7", ESCAPE), []),
    "a footer": (rows(footer=f"{ESCAPE} end"), []),
    "a unit": (rows(f"stimulus,theta1,theta2\nN m,{ESCAPE},deg"), ["--list"]),
}


@pytest.mark.parametrize("name", CONTROLS)
def test_no_control_character_of_a_file_reaches_a_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    content, options = CONTROLS[name]
    (tmp_path / "a.csv").write_text(content, encoding="utf-8")
    main(["import", str(tmp_path / "a.csv"), *OPTIONS, *options])
    out = "".join(capsys.readouterr())
    assert all(c.isprintable() or c == "\n" for c in out), repr(out)
    assert "\\x1b" in out or "\\u202e" in out or name == "a cell"


def test_texts_of_others_are_escaped_wherever_a_table_or_a_sentence_is_made() -> None:
    for told in (table(["a", ESCAPE], [[ESCAPE, "b"]]), fill(ESCAPE), folded(f"a  {ESCAPE}\nb"), escaped(ESCAPE)):
        assert "\x1b" not in told
        assert "\\x1b[2J" in told
    assert escaped("ü ± 3 °\xa0%\nnext") == "ü ± 3 °\xa0%\nnext"
    assert escaped("a\tb\r\udcfc\x85") == "a\\tb\\r\\udcfc\\x85"


def test_names_in_a_recording_hold_no_control_characters() -> None:
    recording = mc.simulate(amplitude=5.0, cycles=4, seed=4)
    changed = mc.Recording(recording.trials, 100.0, None, name=ESCAPE, person="a\x1b", provenance="one\ntwo\x07")
    assert (changed.name, changed.person, changed.provenance) == ("\\x1b[2J\\x1b]0;x\\x07", "a\\x1b", "one\ntwo\\x07")
    f = np.array([0.1, 0.2, 0.3, 0.4])
    y = np.full((4, 2), 0.1 + 0.1j)
    named = FrfRecording(f, y, np.tile(1e-4 * np.eye(2), (4, 1, 1)).astype(complex), name=ESCAPE)
    assert "\x1b" not in named.name + repr(named)


def test_a_byte_order_mark_in_front_of_toml_is_left_out(tmp_path: Path) -> None:
    """In a map, a description of a recording and a study file."""
    (tmp_path / "a.csv").write_text(rows())
    text = '\ufeffrate_hz = 100\nunits = {angle = "deg", stimulus = "N m"}\nbody = {height = 1.68, weight = 73}\n'
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    assert import_files([tmp_path / "a.csv"], tmp_path / "map.toml").recording.rate_hz == 100
    (tmp_path / "rec.toml").write_text(text + '[[trials]]\nfile = "a.csv"\n', encoding="utf-8")
    assert isinstance(read_recording(tmp_path / "rec.toml"), Recording)
    study = '\ufeff[study]\nname = "x"\nseed = 1\n\n[group.a]\nrealizations = 2\nstarts = 2\n'
    study += "fmax = [1.2]\namplitude = [3.0]\n"
    (tmp_path / "s.toml").write_text(study, encoding="utf-8")
    assert mc.read_study(tmp_path / "s.toml").study.seed == 1


def test_repeated_columns_of_a_table_of_people_are_refused(tmp_path: Path) -> None:
    for header, name in (("file,person,person", "person"), ("file,person,condition,condition", "condition")):
        (tmp_path / "people.csv").write_text(f"{header}\na.nc,x,y,z\n"[: None if "condition" in header else -3] + "\n")
        with pytest.raises(InputError, match=rf"expected one column '{name}' in the first line"):
            read_people(tmp_path / "people.csv")


@pytest.mark.parametrize(
    "content",
    [
        "file;person\na b.nc;Ann\n".encode("utf-8-sig"),
        "sep=;\nfile;person\na b.nc;Ann\n".encode("utf-16"),
        b"file,person,\na b.nc,Ann,\n",
        b'"","file","person"\n"1","a b.nc","Ann"\n',
        "file\tperson\r\na b.nc\tAnn\r\n\t\r\n".encode("cp1252"),
    ],
)
def test_a_table_of_people_of_any_program_is_read(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "people.csv").write_bytes(content)
    (row,) = read_people(tmp_path / "people.csv")
    assert (row.file.name, row.person) == ("a b.nc", "Ann")


def test_a_table_with_more_cells_than_names_shifts_no_column() -> None:
    with pytest.raises(ValueError, match="line 2: expected 2 columns, got 3"):
        labelled(b"a,b\nK11,0,1\nK11,1,2\n")
    assert labelled(b"a,b\nx,0,1\ny,1,2\n").header == ["", "a", "b"]  # names of rows, as R writes them
    with pytest.raises(ValueError, match="found a workbook"):
        labelled(b"PK\3\4")


FRF = "f,gain1,phase1,sd1\n" + "\n".join(
    f"{f},{0.1 / (1 + f):.4f},{-40 * f:.4f},0.01" for f in (0.1, 0.2, 0.4, 0.8, 1.6)
)


@pytest.mark.parametrize(
    ("old", "new", "units", "message"),
    [
        ("phase1", "phase1 (rad)", "angle = 'deg'", r"phase1: unit: expected deg, but the file states rad"),
        ("f,", "f (rad/s),", "angle = 'deg'", r"f: unit: expected Hz, but the file states rad/s"),
        ("gain1", "gain1 (dB)", "angle = 'deg'", r"gain1: unit: expected an angle, but the file states dB"),
        ("gain1", "gain1 (mm/Nm)", "angle = 'deg'", r"gain1: unit: expected an angle, but the file states mm"),
        ("gain1", "gain1 (rad/Nm)", "angle = 'deg'", r"gain1: unit: declared deg, but the file states rad"),
        ("gain1", "gain1 (deg/cm)", "angle = 'deg'", r"gain1: unit: expected a torque, but the file states cm"),
        ("gain1", "gain1 (deg/Nm)", "", None),
        ("f,gain1,phase1", "f (Hz),gain1 (deg/Nm),phase1 (deg)", "angle = 'deg', stimulus = 'N m'", None),
    ],
)
def test_units_in_a_table_of_responses_are_used_and_may_not_contradict(
    tmp_path: Path, old: str, new: str, units: str, message: str | None
) -> None:
    (tmp_path / "frf.csv").write_text(FRF.replace(old, new, 1))
    sheet = tmp_path / "frf.toml"
    sheet.write_text(f"units = {{{units}}}\nbody = {{reference = 'goodworth2018'}}\nfrf = {{file = 'frf.csv'}}\n")
    if message is None:
        found = read_recording(sheet)
        assert isinstance(found, FrfRecording)
        assert abs(found.y[0, 0]) == pytest.approx(np.deg2rad(0.0909), rel=1e-6)
        return
    with pytest.raises(RecordingError, match=message):
        read_recording(sheet)


def test_a_quote_that_is_not_closed_takes_no_rows_away() -> None:
    with pytest.raises(ValueError, match="line 3: expected cells of text or numbers, with quotes in pairs"):
        labelled(b'a,b,note\n1,2,x\n3,4,"y\n5,6,z\n')
    assert labelled(b'a,"b, c"\n1,"x\ny"\n') == (["a", "b, c"], [(2, ["1", "x\ny"])])
    assert labelled(b'"a,b";"c,d"\n1;2\n').header == ["a,b", "c,d"]


def test_a_cell_too_many_is_no_name_of_a_row_where_rows_have_none() -> None:
    with pytest.raises(ValueError, match="line 2: expected 2 columns, got 3; row names need a column name too"):
        labelled(b"a,b\n1,0,1\n2,1,2\n", name_rows=False)
