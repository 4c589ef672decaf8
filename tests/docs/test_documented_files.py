"""Every recording of the documentation goes through the fit, the diagnosis and both pages.

Of a page run the blocks that make files; recordings of the same name but for a number are of one kind.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from code_blocks import ROOT, Block, run_page
from many_people import COMTEST, needs_comtest
from real_person import WANG, needs_wang

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.recordings.frf import FrfRecording

RECORDINGS = {
    "mcstudy/recordings/README.md": (
        *("example/recording.toml", "subject1.nc", "spreadsheet.nc", "matlab.nc", "motion.nc"),
        *("subject1.toml", "published.toml", "headset.nc", "rods.nc", "mocap.nc"),
        *("people/AB01_c1_scene_1_deg.nc", "people/CD02_c1_scene_1_deg.nc"),
    ),
    "pipelines/docs/tutorials/diagnose.md": ("subject1/recording.toml",),
    "pipelines/docs/tutorials/sway.md": ("small.nc", "large.nc"),
    "pipelines/docs/tutorials/tilt.md": ("young0.nc", "old0.nc"),
}
"""Recordings by the page that makes them."""

AGAIN = ("subject1.nc", "spreadsheet.nc", "matlab.nc", "motion.nc")
"""The first of them in another form."""

SAME_SWAY = ("rods.nc", "mocap.nc", "people/AB01_c1_scene_1_deg.nc", "people/CD02_c1_scene_1_deg.nc", "large.nc")
"""The sway of headset.nc, or of small.nc, once more."""

GROUPS = {"mcstudy/recordings/README.md": ("people.toml",)}
"""Descriptions of the FRFs of a group."""

ASKS = re.compile(r"diagnos|mc\.fit\(|^mcstudy (?!import|simulate)", re.MULTILINE)
"""What no block that makes files holds."""

FMAX = 2.0
"""Hz; the highest frequency of the fits, which keeps them short."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder with the files of each page."""
    folders = {page: tmp_path_factory.mktemp("page") for page in RECORDINGS}
    for page, folder in folders.items():
        with pytest.MonkeyPatch.context() as patch:
            run_page(page, folder, patch, makes_files)
    return folders


def makes_files(_: Block, text: str) -> bool:
    return not ASKS.search(text)


def goes_through(path: Path, folder: Path, data: Path | None = None) -> None:
    """The fit, the diagnosis and both pages of a recording, which must be read."""
    recording = mc.read_recording(path, data=data)
    fmax = None if isinstance(recording, FrfRecording) else FMAX
    fit, diagnosis = mc.fit(recording, fmax=fmax), mc.diagnose(recording, fast=True, fmax=fmax)
    assert fit.text()
    assert diagnosis.verdict()
    for name, result in (("fit", fit), ("diagnosis", diagnosis)):
        page = result.to_html(folder / f"{name}.html").read_text(encoding="utf-8")
        assert "</html>" in page


@pytest.mark.parametrize(
    ("page", "name"),
    [(page, name) for page, names in RECORDINGS.items() for name in names if name not in (*AGAIN, *SAME_SWAY)],
)
def test_a_documented_recording_goes_through_everything(
    made: dict[str, Path], page: str, name: str, tmp_path: Path
) -> None:
    goes_through(made[page] / name, tmp_path)


@pytest.mark.parametrize("name", AGAIN)
def test_a_recording_in_another_form_holds_the_same_signals(made: dict[str, Path], name: str) -> None:
    folder = made["mcstudy/recordings/README.md"]
    first, again = mc.read_recording(folder / "example" / "recording.toml"), mc.read_recording(folder / name)
    assert len(again.trials) == len(first.trials)
    for a, b in zip(first.trials, again.trials, strict=True):
        np.testing.assert_allclose(b.theta, a.theta, atol=1e-6)
        np.testing.assert_allclose(b.stimulus, a.stimulus, atol=0.02)  # of 5 N m; that of motion.nc was resampled


@pytest.mark.parametrize("page", RECORDINGS)
def test_no_recording_of_a_page_is_forgotten(made: dict[str, Path], page: str) -> None:
    folder = made[page]
    sheets = [
        p for p in folder.glob("*.toml") if re.search(r"^(\[\[trials\]\]|frf = |\[frf_group\])", p.read_text(), re.M)
    ]
    found = [*folder.glob("*.nc"), *folder.glob("people/*.nc"), *folder.glob("*/recording.toml"), *sheets]
    kinds = {re.sub(r"\d+\.nc$", ".nc", p.relative_to(folder).as_posix()) for p in found}
    assert kinds == {re.sub(r"\d+\.nc$", ".nc", name) for name in (*RECORDINGS[page], *GROUPS.get(page, ()))}


def test_a_published_response_is_diagnosed_with_the_bootstrap_too(made: dict[str, Path], tmp_path: Path) -> None:
    diagnosis = mc.diagnose(made["mcstudy/recordings/README.md"] / "published.toml", bootstrap=50)
    assert diagnosis.verdict()
    diagnosis.to_html(tmp_path / "diagnosis.html")


@pytest.mark.parametrize("verb", [["fit"], ["gap", "diagnose", "--fast"], ["gap", "report", "-o", "page.html"]])
def test_responses_of_a_group_are_for_the_comparison_only(
    made: dict[str, Path], verb: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = made["mcstudy/recordings/README.md"]
    monkeypatch.chdir(folder)
    assert main([*verb, "people.toml"]) == 2
    said = capsys.readouterr()
    assert "people.toml: this is a description of the FRFs of a group (for mcstudy gap compare)" in said.err
    assert said.err.count("\n") == 1
    assert not (folder / "page.html").exists()


def test_responses_of_a_group_are_compared_or_too_few_people_are_told(
    made: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    group = str(made["mcstudy/recordings/README.md"] / "people.toml")
    code = main(["gap", "compare", group, "--condition", "open", "--with-condition", "closed", "--permutations", "49"])
    said = capsys.readouterr()
    assert code in (0, 2)
    assert said.err.count("\n") <= 1
    assert "people" in said.out + said.err


@needs_wang
def test_the_description_of_a_real_person_goes_through_everything(tmp_path: Path) -> None:
    goes_through(ROOT / "pipelines" / "recordings" / "wang.toml", tmp_path, WANG)


@needs_comtest
def test_the_description_of_many_people_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(ROOT / "pipelines" / "recordings" / "comtest.toml", tmp_path)
    conditions = list(mc.read_frf_group(tmp_path / "comtest.toml", data=COMTEST).condition.values)
    where = [str(tmp_path / "comtest.toml"), "--data", str(COMTEST), "--permutations", "49"]
    assert main(["gap", "compare", *where, "--condition", conditions[0], "--with-condition", conditions[1]]) == 0
    assert "people" in capsys.readouterr().out
