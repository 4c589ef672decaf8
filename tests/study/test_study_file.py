"""A study file is read exactly, or refused in one line that says where and what was expected."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcstudy.errors import DesignError
from mcstudy.study.catalogue import shipped
from mcstudy.study.instability import refuse_unstable
from mcstudy.study.study_file import changes, parse_study, read_study

BAD = [
    # (replace, by, field the message must name, something of what was expected)
    ("seed = 7", "seeds = 7", "study.seeds", "unknown key, expected one of name, seed"),
    ("seed = 7", "", "study.seed", "missing"),
    ("seed = 7", "seed = -1", "study.seed", "at least 0"),
    ("seed = 7", "seed = 7.5", "study.seed", "whole number"),
    ("seed = 7", "seed = 2018-01-01", "study", "no dates"),
    ("[study]", "[other]\n[study]", "other", "unknown key"),
    ("[study]", "fit = 3\n[study]", "fit", "expected a table"),
    ("starts = 6", "starts = 0", "group.noisy.starts", "at least 1, got 0"),
    ("starts = 6", "strats = 6", "group.noisy.strats", "unknown key"),
    ("realizations = 5", "realizations = true", "group.noisy.realizations", "whole number"),
    ("realizations = 5", "realizations = 100000000", "group.noisy.realizations", "at most 10000000"),
    ("[0.41, 1.2]", "[0.01]", "group.noisy.fmax", "at least 0.02287 Hz, the first frequency, got 0.01"),
    ("[0.41, 1.2]", "[9.0]", "group.noisy.fmax", "at most 8.005 Hz, the last frequency"),
    ("[0.41, 1.2]", "[0.03]", "group.noisy.fmax", "expected at least 3 frequencies"),
    ("[0.41, 1.2]", "[]", "group.noisy.fmax", "at least 1 item"),
    ("[0.41, 1.2]", "'1.2'", "group.noisy.fmax", "expected a list"),
    ("[3.0, 5.0]", "[3.0, 3.0]", "group.noisy.amplitude", "listed once"),
    ("[3.0, 5.0]", "[-3.0]", "group.noisy.amplitude.0", "expected a number from 1e-06 to 1e+06, got -3.0"),
    ("[3.0, 5.0]", "[nan]", "group.noisy.amplitude.0", "finite"),
    ("[group.noisy]", "[group.'../../etc']", "group.../../etc", "pattern"),
    ('"none"', '"quantum"', "group.ideal.simulator", "'none', 'spectral'"),
    ("seed = 7", "seed = 7\n[fit]\ncost = 'ml'", "group.ideal.fit.cost", "expected 'paper'"),
    ("seed = 7", "seed = 7\n[fit]\nsolver = 'magic'", "fit.solver", "'lm', 'trf', 'trust-constr' or 'interior_point'"),
    ("seed = 7", "seed = 7\n[fit]\ntolerance = 2.0", "fit.tolerance", "less than 1"),
    (
        "seed = 7",
        "seed = 7\n[model]\nkind = 'os:system'",
        "model.kind",
        "a model file (.toml) or one of two_segment, one_segment, elbow, ",
    ),
    ("seed = 7", "seed = 7\n[model.truth]\nK99 = 1.0", "group.noisy.model.truth.K99", "unknown parameter"),
    ("seed = 7", "seed = 7\n[model.body]\nmass = 1.0", "group.noisy.model.body.mass", "unknown key"),
    (
        "seed = 7",
        "seed = 7\n[model.truth]\nK11 = 5.0\n[model.bounds.absolute]\nK11 = [10.0, 20.0]",
        "group.noisy.model.truth.K11",
        "inside its bounds [10.0, 20.0], got 5.0",
    ),
    ("seed = 7", "seed = 7\n[model.bounds]\nlower = 2.0", "group.noisy.model.bounds", "lower < upper"),
    (
        "seed = 7",
        "seed = 7\n[model.bounds]\nlower = 2.0\nupper = 0.0",
        "group.noisy.model.bounds",
        "lower 2.0, upper 0.0",
    ),
    (
        "seed = 7",
        "seed = 7\n[model.bounds.absolute]\nK11 = [2.0, 0.0]",
        "group.noisy.model.bounds.absolute.K11",
        "expected lower < upper, got [2.0, 0.0]",
    ),
    ("seed = 7", "seed = 7\n[model.bounds]\ndelay_margin_s = 0.09", "group.noisy.model.bounds.delay_margin_s", "Td1"),
    ("seed = 7", "seed = 7\n[stimulus]\nstages = 5", "group.noisy.spectra.points", "'odd_lines'"),
    ("seed = 7", "seed = 7\n[stimulus]\nstate_s = 0.021", "group.noisy.stimulus.state_s", "whole number of samples"),
    ("seed = 7", "seed = 7\n[stimulus]\ndiscard = 6", "group.noisy.stimulus.discard", "fewer than cycles"),
    ("seed = 7", "seed = 7\n[stimulus]\ncycles = 99999", "group.noisy.stimulus.cycles", "at most"),
    ("seed = 7", "seed = 7\n[stimulus]\nkind = 'surface_tilt'", "group.noisy.amplitude", "at most 0.2 rad, got 5 rad"),
    ("seed = 7", "seed = 7\n[spectra]\nexclude_hz = [3.33]", "group.noisy.spectra.exclude_hz", "got 3.33"),
    ("seed = 7", "seed = 7\n[spectra]\nwidth = 0.0", "spectra.width", "greater than 0"),
    (
        "seed = 7",
        "seed = 7\n[spectra]\nwidth = 0.5\npoints = 'odd_lines'",
        "group.noisy.spectra.width",
        "one line per point",
    ),
]


@pytest.mark.parametrize(("old", "new", "field", "expected"), BAD, ids=[f"{b[2]}-{b[1][:30]}" for b in BAD])
def test_a_mistake_is_one_line_with_file_field_and_expectation(
    tmp_path: Path, tiny: str, old: str, new: str, field: str, expected: str
) -> None:
    assert old in tiny
    file = tmp_path / "bad.toml"
    file.write_text(tiny.replace(old, new, 1))
    with pytest.raises(DesignError) as caught:
        read_study(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: {field}: ")
    assert expected in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "content",
    [
        b"[study",
        b"\xff\xfe",
        b"x = " + b"[" * 5000,
        b"",
        b"# only a comment",
        b" " * 2_000_000,
        b"[study]\nname = 'a'\nseed = 0x" + b"f" * 5000 + b"\n[group.a]\nstarts = 1",
    ],
)
def test_what_is_not_a_study_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(DesignError, match=r"^[^\n]+$"):
        read_study(file)


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(DesignError, match=str(path)):
            read_study(path)


def test_the_canonical_text_reads_back_as_the_same_study(tiny: str) -> None:
    study = parse_study(tiny)
    again = parse_study(study.to_toml())
    assert again == study
    assert again.fingerprint == study.fingerprint
    assert again.to_toml() == study.to_toml()


def test_writing_out_a_default_does_not_change_the_fingerprint(tiny: str) -> None:
    spelled = tiny + "\n[fit]\nsolver = 'lm'\n[model.truth]\nK11 = 1057\n[noise]\npsd = [4e-4, 7e-5]\n"
    assert parse_study(spelled).fingerprint == parse_study(tiny).fingerprint


def test_prose_and_the_order_of_a_list_do_not_change_the_fingerprint(tiny: str) -> None:
    edited = tiny.replace("seed = 7", 'seed = 7\ndescription = "reworded"').replace("[3.0, 5.0]", "[5.0, 3.0]")
    assert parse_study(edited).fingerprint == parse_study(tiny).fingerprint


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("realizations = 5", "realizations = 6", "group.noisy.realizations = 5, not 6"),
        ("seed = 7", "seed = 8", "study.seed = 7, not 8"),
        ("seed = 7", "seed = 7\n[model.truth]\nK11 = 1000.0", "group.noisy.model.truth.K11 = 1057.0, not 1000.0"),
    ],
)
def test_every_change_of_a_number_changes_the_fingerprint_and_is_named(
    tiny: str, old: str, new: str, line: str
) -> None:
    before, after = parse_study(tiny), parse_study(tiny.replace(old, new, 1))
    assert before.fingerprint != after.fingerprint
    assert line in changes(before, after)


def test_a_group_overrides_single_keys_of_a_section(tiny: str) -> None:
    study = parse_study(
        tiny + "[fit]\nsolver = 'trf'\nmax_iterations = 50\n[group.ideal.fit]\nsolver = 'trust-constr'\n"
    )
    assert (study.groups["noisy"].fit.solver, study.groups["noisy"].fit.max_iterations) == ("trf", 50)
    assert (study.groups["ideal"].fit.solver, study.groups["ideal"].fit.max_iterations) == ("trust-constr", 50)


def test_the_model_of_the_study_is_written_out_in_full(tiny: str) -> None:
    study = parse_study(tiny)
    assert len(study.groups["noisy"].model.truth) == 12
    assert study.groups["noisy"].model.body["J1"] == 51.26


STUDIES = list(shipped().values())


@pytest.mark.parametrize("file", STUDIES, ids=lambda p: p.name)
def test_every_shipped_pipeline_is_valid_and_says_what_it_regenerates(file: Path) -> None:
    study = read_study(file)
    assert study.study.name == file.stem
    assert file.read_text().startswith("# ")
    assert study.study.regenerates or study.study.name == "quick"


@pytest.mark.parametrize("file", STUDIES, ids=lambda p: p.name)
def test_no_shipped_body_falls(file: Path) -> None:
    refuse_unstable(read_study(file))


def test_the_large_pipeline_has_a_million_fits() -> None:
    assert read_study(Path(__file__).parents[2] / "pipelines" / "large.toml").fits >= 1_000_000


def test_a_notebook_shows_the_groups_and_nothing_of_them_becomes_markup(tiny: str) -> None:
    shown = parse_study(tiny.replace("seed = 7", 'seed = 7\ndescription = "a <b> & c"'))._repr_html_()
    assert "a &lt;b&gt; &amp; c" in shown
    assert "<th scope='row'>noisy</th><td>5</td><td>6</td><td>0.41, 1.2</td><td>3, 5</td>" in shown
    assert "128 fits, seed 7" in shown
