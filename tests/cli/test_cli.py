"""The command: quick help, one line and exit code 2 for bad input, readable output."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from commands import command, refused, told
from mcstudy_challenge.challenge_file import read_challenge
from tiny_studies import EIGHT_FITS as STUDY

from mcstudy.cli import main
from mcstudy.cli.parser import parser_of
from mcstudy.cli.verbs import module, verbs
from mcstudy.cli.verbs.completion import SHELLS
from mcstudy.cli.verbs.help import TOPICS, page
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.files import schema
from mcstudy.fitting.problem import Fits
from mcstudy.fitting.status import Status
from mcstudy.report.document import write_page
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.execution import tasks
from mcstudy.study.study_file import parse_study, read_study


@pytest.fixture
def study(tmp_path: Path) -> Path:
    file = tmp_path / "tiny.toml"
    file.write_text(STUDY)
    return file


@pytest.fixture
def cube(study: Path, tmp_path: Path) -> Path:
    out = tmp_path / "out.zarr"
    told("run", study, "-o", out, "--workers", 1)
    return out


def topic_of(verb: str) -> str:
    """The topic that a verb states, or none."""
    return str(getattr(module(verb), "TOPIC", ""))


def test_help_and_version_import_nothing_heavy() -> None:
    script = """
import sys
from mcstudy.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
main(["--version"])
heavy = {"numpy", "scipy", "numba", "xarray", "dask", "distributed", "zarr", "pydantic"} & set(sys.modules)
assert not heavy, heavy
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=True)
    assert f"mcstudy {version('mcstudy')}" in done.stdout
    for verb in verbs():
        assert verb in done.stdout


def test_every_study_that_comes_with_mcstudy_is_listed_found_by_name_and_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quick").mkdir()  # a name without .toml is that of a shipped study
    listed = told("studies")
    for name in ("goodworth2018", "quick"):
        assert f"{name} " in listed
        assert read_study(name).study.name == name
        assert parse_study(told("studies", name)).fingerprint == read_study(name).fingerprint
    assert "gap_challenge" not in listed
    assert read_challenge("gap_challenge_small").challenge.name == "gap_challenge_small"
    (tmp_path / "quick.toml").write_text(STUDY)
    assert read_study("quick.toml").fits == 8


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("goodworth", "(similar: goodworth2018)"),
        ("pipelines/quick.toml", "(similar: quick)"),
        ("x", "large, low_frequency"),
    ],
)
def test_a_study_that_is_not_there_is_one_line_with_similar_names(
    name: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    error = refused("plan", name)
    assert error.startswith(f"mcstudy: {name}: expected a study file")
    assert hint in error


def test_help_prints_the_page_of_every_topic_and_of_verbs() -> None:
    listed = told("help")
    for topic in TOPICS:
        assert f"\n{topic} " in listed
        assert told("help", topic).strip().endswith(f"This page: {page(topic)}")
    assert {topic_of(verb) for verb in verbs()} - {""} <= set(TOPICS)
    assert "usage: mcstudy gap" in (text := told("help", "gap"))
    assert text.strip().endswith(f"This page: {page('diagnosis')}")
    assert "similar: diagnosis" in refused("help", "diagnosys")


@pytest.mark.parametrize(
    ("verb", "rest"), [("gap next", "a.nc"), ("gap challenge run", "a.toml -o a"), ("fit", "a.nc")]
)
def test_an_unknown_option_shows_the_usage_of_its_own_verb(
    verb: str, rest: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(f"{verb} {rest} --fats".split())
    said = capsys.readouterr().err
    assert said.startswith(f"usage: mcstudy {verb} [")
    assert "error: unrecognized arguments: --fats" in said


def test_help_prints_the_options_of_a_verb_of_a_verb() -> None:
    assert told("help", "gap", "challenge", "run").startswith("usage: mcstudy gap challenge run ")
    assert "nxt: expected one of effects, " in refused("help", "gap", "nxt")
    assert "quick: expected no further word after mcstudy run" in refused("help", "run", "quick")


def test_every_verb_that_works_on_data_has_a_page() -> None:
    assert {verb for verb in verbs() if not topic_of(verb)} - {*TOPICS} == {"warm", "help", "completion"}


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_knows_every_verb_and_is_a_valid_script(shell: str) -> None:
    script = told("completion", shell)
    assert all(verb in script for verb in verbs())
    assert "until-mcse" in script
    if program := shutil.which(shell):
        subprocess.run([program, "-n"], input=script, text=True, check=True)


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("mcstudy ve", {"verify"}),
        ("mcstudy run goodworth", {"goodworth2018", "goodworth2018_inferred", "goodworth_mine.toml"}),
        ("mcstudy studies goodworth", {"goodworth2018", "goodworth2018_inferred"}),
        ("mcstudy show goodworth", {"goodworth_mine.toml"}),
        ("mcstudy simulate --effect sensor_lag_t", {"sensor_lag_theta1", "sensor_lag_theta2"}),
        ("mcstudy help sol", {"solve"}),
        ("mcstudy gap challenge sc", {"score"}),
        ("mcstudy run --sch", {"--scheduler"}),
    ],
)
def test_bash_offers_verbs_options_shipped_studies_effects_and_files(
    typed: str, offered: set[str], tmp_path: Path
) -> None:
    (tmp_path / "goodworth_mine.toml").touch()
    words = " ".join(f"'{word}'" for word in typed.split(" "))
    ask = f"COMP_WORDS=({words}); COMP_CWORD={typed.count(' ')}; _shtab_mcstudy 2>/dev/null\n"
    answer = subprocess.run(
        ["bash"],
        input=told("completion", "bash") + "\n" + ask + "printf '%s\\n' \"${COMPREPLY[@]}\"\n",
        text=True,
        check=True,
        capture_output=True,
        cwd=tmp_path,
    )
    assert set(answer.stdout.split()) == offered


def test_bad_study_files_are_one_line_on_stderr_and_exit_2(tmp_path: Path, study: Path) -> None:
    bad = {
        "unknown key": STUDY.replace("starts", "strats"),
        "zero starts": STUDY.replace("starts = 4", "starts = 0"),
        "fmax": STUDY.replace("fmax = [1.2]", "fmax = [0.001]"),
        "outside bounds": STUDY + "[model.truth]\nK11 = 5.0\n[model.bounds.absolute]\nK11 = [10.0, 20.0]\n",
        "not toml": "[",
    }
    files = [tmp_path / "missing.toml", tmp_path]
    for name, text in bad.items():
        files.append(tmp_path / f"{name}.toml")
        files[-1].write_text(text)
    for file in files:
        for verb in ("run", "plan"):
            assert refused(verb, file).startswith(f"mcstudy: {file}: ")
    assert study.exists()


def test_a_cube_of_another_version_is_one_line_and_exit_2(cube: Path) -> None:
    metadata = cube / "zarr.json"
    metadata.write_text(metadata.read_text().replace("study_cube:1.0.0", "study_cube:9.0.0"))
    for words in (("status", cube), ("show", cube), ("status", cube.parent)):
        assert refused(*words)


def test_run_says_what_it_did_and_a_second_run_that_nothing_was_left(study: Path, tmp_path: Path) -> None:
    words = ("run", study, "-o", tmp_path / "out.zarr", "--workers", 1)
    first = command(*words)
    assert "8 fits in" in first.out
    assert "8/8 fits (100 %)" in first.err
    assert told(*words) == f"{tmp_path / 'out.zarr'}: complete: nothing to run (8 fits stored)\n"


def test_status_counts_fits_by_outcome(cube: Path) -> None:
    assert "noisy" in told("status", cube)
    printed = json.loads(told("status", cube, "--json"))
    counts = printed["groups"]["noisy"]
    assert sum(counts.values()) == 8
    assert counts["pending"] == 0
    schema.validate("status", printed, "status")


def test_failed_fits_are_listed_and_exit_4(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: object, __: object, starts: np.ndarray, *___: object) -> Fits:
        return Fits.failed(starts, Status.SOLVER_ERROR)

    monkeypatch.setattr(tasks, "fit_queue", broken)
    code, out, _ = command("run", study, "-o", tmp_path / "out.zarr", "--workers", 1)
    assert code == Exit.FITS_FAILED
    assert out.count("failed fit: ") == 8
    assert "group noisy, amplitude 5, fmax 1.2 Hz, realization 1, start 3: the solver raised an error" in out


def test_verify_passes_a_sound_cube_and_names_damage(cube: Path) -> None:
    assert ": 0 damaged; 1 chunks read" in told("verify", cube)
    (chunk,) = (cube / "noisy" / "cost").glob("c*")
    chunk.write_bytes(b"nonsense")
    damaged = command("verify", cube)
    assert damaged.code == Exit.DIFFERS
    assert f"damage: {chunk}" in damaged.out


def test_plan_tells_cost_and_precision(study: Path) -> None:
    out = told("plan", study)
    assert "total: 8 fits" in out
    assert re.search(r"^noisy +5 +1\.2 +[\d.]+ +[\d.]+ \(\w+\)$", out, re.MULTILINE)


@pytest.fixture
def no_drawings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages are words alone: most of the time a page takes goes into figures."""
    for name, result in (("drawn", None), ("share_axes", None), ("left_margin", 0.0), ("rendered", ("", {}))):
        monkeypatch.setattr(f"mcstudy.report.figure.{name}", lambda *_, result=result: result)


@pytest.fixture
def falling(study: Path) -> Path:
    """A study of a body whose stiffness does not hold it up, and of one that stands."""
    weak = "[group.weak]\nrealizations = 2\nstarts = 2\nfmax = [1.2]\namplitude = [5.0]\n[group.weak.model.truth]\n"
    study.write_text(STUDY + weak + "K11 = 300.0\n")
    return study


def test_a_body_that_falls_is_refused_in_one_line(falling: Path) -> None:
    for verb in ("plan", "run"):
        line = refused(verb, falling)
        assert line.startswith(f"mcstudy: {falling}: group.weak.model.truth: expected a stable closed loop")
        assert "growth rate +1.44 1/s" in line
        assert "--allow-unstable" in line


def test_a_body_that_falls_is_never_simulated_in_time(falling: Path) -> None:
    falling.write_text(falling.read_text().replace("[group.weak]", '[group.weak]\nsimulator = "time_domain"'))
    for verb in ("plan", "run"):
        line = refused(verb, falling, "--allow-unstable")
        assert "an unstable body cannot be simulated in time; use simulator 'spectral'" in line


@pytest.mark.usefixtures("no_drawings")
def test_a_body_that_falls_is_warned_of_wherever_it_is_shown(falling: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.zarr"
    warning = "the closed loop of the true parameters is unstable (growth rate +1.44 1/s)"
    assert f"warning: group weak: {warning}" in told("plan", falling, "--allow-unstable")
    ran = command("run", falling, "-o", out, "--workers", 1, "--allow-unstable")
    assert ran.code == Exit.DONE
    assert f"warning: group weak: {warning}" in ran.err
    assert " ".join(told("show", out).split()).count(f"Warning: {warning}") == 1
    groups = json.loads(told("show", out, "--json"))["groups"]
    assert [warning in " ".join(groups[name]["notes"]) for name in ("noisy", "weak")] == [False, True]
    told("report", out)
    page = tmp_path / "out.html"
    assert f"<strong>Warning:</strong> group weak: {warning}" in page.read_text(encoding="utf-8")


@pytest.mark.usefixtures("no_drawings")
def test_show_and_report_name_the_cell_without_a_number(study: Path, tmp_path: Path) -> None:
    """Bounds a trillion times too far apart: to rounding, the points do not determine the parameters."""
    out, page = tmp_path / "out.zarr", tmp_path / "page.html"
    bounds = "[group.noisy.model.bounds.absolute]\nK11 = [0.0, 1e15]\n"
    study.write_text(STUDY.replace("realizations = 2", "realizations = 4") + bounds)
    told("run", study, "-o", out, "--workers", 1)
    text = " ".join(told("show", out, "--all").split())
    assert "No Cramér-Rao bound (frequency: 16 points do not determine 12 parameters): 5 N m, Fmax 1.2 Hz." in text
    assert "K11 " in text
    group = json.loads(told("show", out, "--json"))["groups"]["noisy"]
    assert any("No Cramér-Rao bound" in note and "Fmax 1.2 Hz" in note for note in group["notes"])
    assert all(p["efficiency"]["value"] is None for p in group["cells"][0]["parameters"] if "efficiency" in p)
    told("report", out, "-o", page)
    assert "None at 5 N·m up to 1.2 Hz: frequency: 16 points do not determine 12 parameters." in page.read_text()


def test_one_realization_is_shown_with_what_it_cannot_tell(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.zarr"
    study.write_text(STUDY.replace("realizations = 2", "realizations = 1"))
    told("run", study, "-o", out, "--workers", 1)
    text = " ".join(told("show", out, "--all").split())
    assert "No Monte Carlo errors and no spread from so few realizations: 5 N m, Fmax 1.2 Hz (1)." in text


def test_an_unknown_verb_is_refused_with_the_nearest() -> None:
    assert refused("ruin").rstrip() == "mcstudy: ruin: expected a verb (similar: run); mcstudy --help lists them"


def test_a_verb_of_the_gap_is_called_without_it(tmp_path: Path) -> None:
    missing = tmp_path / "none.nc"
    assert refused("diagnose", missing) == refused("gap", "diagnose", missing)


def test_show_says_which_parameter_its_bounds_hold(tmp_path: Path) -> None:
    """Bounds a billionth apart leave nothing to estimate: there is no Cramér-Rao bound, and no failure."""
    file, out = tmp_path / "narrow.toml", tmp_path / "narrow.zarr"
    bounds = "[group.noisy.model.bounds.absolute]\nKpas1 = [179.9999999995, 180.0000000005]\n"
    truth = "[group.noisy.model.truth]\nKpas1 = 180.0\n"
    file.write_text(STUDY.replace("realizations = 2", "realizations = 4") + truth + bounds)
    told("run", file, "-o", out, "--workers", 1)
    rows = [line.split() for line in told("show", out, "--all").splitlines() if line.startswith("Kpas1 ")]
    assert rows
    assert rows[0][-1] in ("fixed", "-")
    parameters = json.loads(told("show", out, "--json"))["groups"]["noisy"]["cells"][0]["parameters"]
    found = {p["name"]: p["efficiency"] for p in parameters}
    assert [name for name, e in found.items() if e["held"]] == ["Kpas1", "K11+Kpas1"]
    (applies,) = {e["applies"] for e in found.values()}
    assert [name for name, e in found.items() if e["value"] is None] == (
        ["Kpas1", "K11+Kpas1"] if applies else list(found)
    )


def test_plan_and_run_where_the_system_does_not_tell_which_cores_are_ours(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on macOS."""
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    assert "on 3 threads under the present load" in told("plan", study)
    told("run", study, "-o", tmp_path / "out.zarr")
    monkeypatch.setattr(os, "cpu_count", lambda: None)  # nobody knows
    assert ClusterOptions().threads == 1


def test_a_page_that_is_not_finished_leaves_the_old_one_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.html"

    def text() -> str:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_page(page, text)
    assert list(tmp_path.iterdir()) == []
    assert write_page(page, lambda: "whole") == page
    with pytest.raises(KeyboardInterrupt):
        write_page(page, text)
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]
    assert page.read_text() == "whole"
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        write_page(tmp_path, text)


@pytest.mark.parametrize(
    "words",
    [
        "fit a.nc 'b c.nc' --fmax 2.0 --accept swapped --with x --with y --bounds Kpas1=0:600 --unpaired --html p.html",
        "gap next a.nc --prior-none 0.1 --kind hip_torque --trials 1 --trials 3 --html p.html",
        "simulate -o a.nc --effect tau=0.1 --amplitude 1.0 2.0 --aperiodic",
        "solve quick --target 'cv(Td1) <= 10%' --over cycles --precision 5.0",
        "report a.zarr",
    ],
)
def test_a_command_is_told_as_it_was_given(words: str) -> None:
    verb, *further = shlex.split(words)
    parser = parser_of(verb)
    assert parser.command(parser.parse_args(further)) == ["mcstudy", verb, *further]
    without = parser.command(parser.parse_args(further), without=("html",))
    assert without == [w for w in ["mcstudy", verb, *further] if w not in ("--html", "p.html")]
