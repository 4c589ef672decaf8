"""The page is one valid, self-contained, traceable file, whatever the study."""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import pytest
import xarray as xr

pytest.importorskip("matplotlib")

from mcstudy_goodworth2018.counterparts import COUNTERPARTS
from mcstudy_goodworth2018.paper.rows import rows

from mcstudy import open_results, program
from mcstudy.analysis.view import StudyView
from mcstudy.api.studies import summary
from mcstudy.cli import main
from mcstudy.exits import Exit
from mcstudy.report.figure import Figure
from mcstudy.report.page import page
from mcstudy.report.study.context import Context
from mcstudy.report.study.search import search_figures
from mcstudy.report.study.tables import headline
from mcstudy.report.typeset import typeset
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.stance.body import two_segment
from mcstudy.study.cube.conversion import structured
from mcstudy.study.design import Study
from mcstudy.study.run import run_study
from mcstudy.text_tables import with_error

VOID = {"meta", "link", "br", "path", "use", "img", "input", "hr"}
PAPER_FIGURES = {key for key, has in COUNTERPARTS.items() if has.number} - {"body", "parameters"}
FURTHER_FIGURES = {"responses_with_noise", "pairs", "waterfall", "atlas", "bystarts", "onestart"}


class Reader(HTMLParser):
    """Collects ids, references and headings, and checks that elements close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.labelled: list[str] = []
        self.links: list[str] = []
        self.headings: list[int] = []
        self.figures: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        got = {k: v or "" for k, v in attrs}
        if "id" in got:
            self.ids.append(got["id"])
        self.labelled += got.get("aria-labelledby", "").split()
        self.links += [got[k] for k in ("href", "src") if k in got]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag == "figure":
            self.figures.append(got["id"])
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="session", params=["paper_page", "other_page", "gap_page"])
def text(request: pytest.FixtureRequest) -> str:
    file: Path = request.getfixturevalue(request.param)
    return file.read_text(encoding="utf-8")


def test_elements_close_ids_are_unique_and_labels_exist(text: str) -> None:
    reader = Reader(text)
    assert reader.open == []
    assert len(reader.ids) == len(set(reader.ids))
    assert set(reader.labelled) <= set(reader.ids)
    assert {link[1:] for link in reader.links if link.startswith("#")} <= set(reader.ids)


def test_nothing_is_fetched_from_anywhere(text: str) -> None:
    assert all(link.startswith("#") or link == "data:," for link in Reader(text).links)
    assert "@import" not in text
    assert re.findall(r"<(?:script|img|iframe|object)[^>]* src", text) == []
    assert set(re.findall(r"https?://[^\s\"'<]+", text)) <= {"http://www.w3.org/2000/svg"}


def test_only_the_pages_own_script_may_run(text: str) -> None:
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    assert len(scripts) == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    assert "default-src 'none'" in policy[1]
    assert f"script-src 'sha256-{digest}';" in policy[1]


def test_the_contents_list_every_section_and_every_figure(text: str) -> None:
    contents = re.search(r"<nav.*?</nav>", text, re.DOTALL)
    assert contents is not None
    listed = re.findall(r'href="#([^"]+)"', contents[0])
    shown = re.findall(r'<(?:section|figure) id="([^"]+)"', text)
    assert listed == shown


def test_headings_descend_one_level_at_a_time_from_one_title(text: str) -> None:
    levels = Reader(text).headings
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in itertools.pairwise(levels))


def test_the_page_is_small(text: str) -> None:
    assert len(text.encode()) < 3_000_000


def test_every_section_and_every_figure_shows_the_command_that_made_it(text: str) -> None:
    for kind in ("section", "figure"):
        parts = re.findall(rf"<{kind} id=.*?</{kind}>", text, re.DOTALL)
        assert parts
        for part in parts:
            assert re.search(r"<code>(mcstudy|python) \w", part), part[:120]


def test_a_study_like_the_papers_has_every_figure_and_every_published_number(
    paper_page: Path, paper_tree: xr.DataTree
) -> None:
    text = paper_page.read_text(encoding="utf-8")
    assert set(Reader(text).figures) >= PAPER_FIGURES | FURTHER_FIGURES
    shown = html.unescape(text)
    for row in rows(StudyView(paper_tree)):
        assert f'<th scope="row">{row.published.label.replace("N m", "N·m")}</th>' in shown


def test_an_efficiency_that_means_nothing_is_not_shown(paper_page: Path, paper_tree: xr.DataTree) -> None:
    assert not paper_tree["accuracy"].mc.efficiency()["applies"].any()
    text = paper_page.read_text(encoding="utf-8")
    assert "efficiency" not in Reader(text).figures
    assert "group accuracy: in every condition more than 10 % of the fits end on a bound" in text


def test_panels_that_compare_share_their_axes(paper_page: Path) -> None:
    text = paper_page.read_text(encoding="utf-8")
    for key, shared in (("controller_error_with_noise", "xy"), ("influence", "x")):
        figure = text[text.index(f'<figure id="{key}"') :]
        data = re.search(r'class="readings">(.*?)</script>', figure)
        assert data is not None
        panels = json.loads(data[1])
        assert len(panels) == 3
        for axis in shared:
            assert len({tuple(p[axis][2:4]) for p in panels}) == 1


def test_what_does_not_apply_is_left_out_with_a_reason(other_page: Path) -> None:
    text = other_page.read_text(encoding="utf-8")
    assert "controller_error" not in Reader(text).figures
    assert "<li>Without noise, a low cost means correct controllers: the study has no group without noise" in text
    assert '<section id="published"' not in text


@pytest.mark.parametrize("study_page", ["paper_page", "other_page"])
def test_true_values_are_labelled_a_stand_in(study_page: str, request: pytest.FixtureRequest) -> None:
    text = request.getfixturevalue(study_page).read_text(encoding="utf-8")
    assert "True values:</strong> stand-in" in text


def test_the_first_screen_answers_the_question_in_numbers(paper_page: Path, paper_tree: xr.DataTree) -> None:
    header = re.search(r"<header>.*?</header>", paper_page.read_text(encoding="utf-8"), re.DOTALL)
    assert header is not None
    tiles = dict(re.findall(r"<span>(.*?)</span><strong>(.*?)</strong>", html.unescape(header[0])))
    ours = {row.published.key: row for row in rows(StudyView(paper_tree))}
    for f in ("0.41", "1.2", "8"):
        row = ours[f"bias_12_{f}"]
        assert tiles[f"Mean |bias|, Fmax {f} Hz"] == f"{with_error(row.ours.value, row.ours.mcse)} %"
    r = paper_tree["accuracy"].mc.correlation().sel(amplitude=5, fmax=1.2, parameter="K11", parameter_2="Kpas1")
    assert tiles["Correlation of K11 and Kpas1"] == typeset(with_error(float(r["value"]), float(r["mcse"])))


def test_the_equations_are_those_of_the_papers_appendix(paper_page: Path) -> None:
    """With the paper's body: A1 g = 494.6, A2 g = 141.8."""
    balances = re.findall(r"<math.*?</math>", paper_page.read_text(encoding="utf-8"))
    ankle, hip = (re.sub("<[^>]*>", "", b) for b in balances)
    assert ankle == ("(51.26s2−494.6)θ1+(19.01s2−141.8)θ2s=u−Kpas1θ1−(K11+B11s)e−Td1sθ1−(K21+B21s)e−Td1sθ2")
    assert hip == "(7.08s2−141.8)θ2s+(11.93s2)θ1=−Kpas2θ2−(K12+B12s)e−Td2sθ1−(K22+B22s)e−Td2sθ2"


def test_tables_i_and_ii_stand_as_the_paper_prints_them(paper_page: Path, paper_tree: xr.DataTree) -> None:
    text = html.unescape(paper_page.read_text(encoding="utf-8"))
    for p in two_segment().parameters:
        assert f'<th scope="row">{p.name}</th><td>{p.value:.4g}</td>' in text
    ours = {row.published.key: row for row in rows(StudyView(paper_tree))}
    table = text[text.index("Table II · ") :]
    for key, what in (("bias_12", "all 12 parameters"), ("bias_10", "stiffness combined (10)")):
        shown = re.search(rf'<th scope="row">{re.escape(what)}</th>(.*?)</tr>', table)
        assert shown is not None
        expected = [(ours[f"{key}_{f}"].published.shown, ours[f"{key}_{f}"]) for f in ("0.41", "1.2", "8")]
        cells = "".join(f"<td>{p}</td><td>{with_error(r.ours.value, r.ours.mcse)} %</td>" for p, r in expected)
        assert shown[1] == cells


def test_an_explanation_that_serves_several_numbers_is_given_once(paper_tree: xr.DataTree) -> None:
    context = Context(paper_tree)
    for key in ("spread_fmax", "spread_amplitude_0.41"):
        context.published[key]["explanation"] = "Bounds at 3 N m."
    text = typeset(headline(context))
    assert text.count("Bounds at 3 N·m.") == 1
    assert text.count('<a href="#note-1">[1]</a>') == 2


def test_text_of_a_study_cannot_become_markup(paper_page: Path) -> None:
    text = paper_page.read_text(encoding="utf-8")
    assert "Paper &amp; &lt;b&gt;miniature&lt;/b&gt;" in text
    assert "<b>miniature" not in text


def test_fingerprint_seed_versions_and_commands_are_on_the_page(paper_page: Path, paper_tree: xr.DataTree) -> None:
    text = paper_page.read_text(encoding="utf-8")
    assert paper_tree.attrs["fingerprint"] in text
    assert f"numpy {structured(paper_tree.attrs, 'environment')['versions']['numpy']}" in text
    assert "mcstudy run paperlike.toml -o OUT" in text


def test_the_same_cube_gives_the_same_bytes(other_cube: Path, other_page: Path) -> None:
    assert page(other_cube) == other_page.read_text(encoding="utf-8")


def test_a_kept_page_is_drawn_again_when_style_or_script_changed(
    other_cube: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page(other_cube)
    monkeypatch.setattr("mcstudy.report.study.page.study_page", lambda *_: "drawn again")
    assert page(other_cube) != "drawn again"
    dress = {f"report/{f.name}" for f in files("mcstudy.report").iterdir() if f.name.endswith((".css", ".html", ".js"))}
    assert dress == {"report/page.css", "report/page.html", "report/page.js"}
    assert dress < set(program.STARTED)  # a change of one is a change of the program
    monkeypatch.setattr(program, "source", lambda *_: "0" * 64)
    assert page(other_cube) == "drawn again"


def test_an_unfinished_cube_has_a_page(other_cube: Path, tmp_path: Path) -> None:
    """All results of one group are missing, as after an interruption: pending, not NaN."""
    half = tmp_path / "half.zarr"
    shutil.copytree(other_cube, half)
    results = ("status", "cost", "estimate", "initial", "iterations", "at_bound", "growth_rate", "frf")
    for name in (*results, "noise_covariance"):
        chunks = list((half / "ml" / name).glob("c.*"))
        assert chunks
        for chunk in chunks:
            chunk.unlink()
    text = page(half)
    assert Reader(text).open == []
    assert "<td>0/5</td>" in text


def test_a_page_that_cannot_be_written_is_one_line(
    other_cube: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["report", str(other_cube), "-o", str(tmp_path / "file" / "p.html")]) == Exit.BAD_INPUT
    assert "p.html: cannot be written: " in capsys.readouterr().err


def test_the_page_of_a_diagnosis_waits_for_no_library_of_studies() -> None:
    script = "import sys, mcstudy.report.diagnosis.page; print({'xarray', 'pandas', 'zarr', 'dask'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_without_matplotlib_the_cure_is_told(tmp_path: Path) -> None:
    script = "import sys; sys.modules['matplotlib'] = None; from mcstudy.cli import main; "
    script += "sys.exit(main(['report', 'x.zarr', '-o', 'y.html']))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == Exit.BAD_INPUT
    assert done.stderr.strip() == "mcstudy: report: matplotlib is not installed; pip install matplotlib"


def test_a_notebook_shows_the_tables_without_matplotlib(other_cube: Path) -> None:
    script = "import sys; sys.modules['matplotlib'] = None; from mcstudy.api.studies import summary; "
    script += f"print(summary({str(other_cube)!r})._repr_html_())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "Group single: best fits, ± MCSE" in done.stdout
    assert Reader(done.stdout).open == []


def test_a_summary_is_text_elsewhere(other_cube: Path) -> None:
    assert "Group single" in summary(other_cube).details()


def test_groups_that_differ_in_the_solver_alone_share_the_figure_of_starts(tmp_path: Path) -> None:
    study = Study("solvers", seed=3)
    axes = {"realizations": 2, "starts": 3, "fmax": [1.2], "amplitude": [5.0]}
    study = study.group("lm", **axes).group("few", **{**axes, "starts": 2})
    study = study.group("emulated", **axes, fit={"solver": "interior_point", "max_iterations": 5})
    study = study.group("ml", **axes, fit={"solver": "interior_point", "max_iterations": 5, "cost": "ml"})
    run_study(study, tmp_path / "out.zarr", ClusterOptions(workers=1))
    context = Context(open_results(tmp_path / "out.zarr"))
    assert context.pools is not None
    assert context.pools.name == "lm"
    assert [view.name for view in context.other_solvers] == ["emulated"]
    (figure,) = [f for f in search_figures(context) if f.key == "starts"]
    assert isinstance(figure, Figure)
    assert [panel.title.split(",")[0] for panel in figure.panels] == ["group lm", "group emulated"]


def test_a_study_of_ones_own_names_no_publication(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = {p.name: 0.97 * p.value for p in two_segment().parameters}
    model = {"truth": own, "body": {"J2": 7.2}}
    axes = {"realizations": 3, "starts": 2, "fmax": [1.2], "amplitude": [4.0]}
    hip, study = {"kind": "hip_torque"}, Study("own", seed=3)
    study = study.group("noisy", **axes, model=model, fit={"cost": "ml"})
    study = study.group("hip", **axes, model=model, fit={"cost": "ml"}, stimulus=hip)
    study = study.group("exact", **axes | {"realizations": 1}, model=model, simulator="none", stimulus=hip)
    out = tmp_path / "out.zarr"
    run_study(study, out, ClusterOptions(workers=1))
    assert main(["show", str(out), "--all"]) == main(["show", str(out), "--json"]) == Exit.DONE
    assert main(["report", str(out), "-o", str(tmp_path / "own.html")]) == Exit.DONE
    shown = capsys.readouterr().out + html.unescape((tmp_path / "own.html").read_text(encoding="utf-8"))
    assert "your values (study file); the body is yours, too" in shown
    assert re.findall(r".{0,60}(?:Goodworth|Table I|Fig\. |the paper).{0,60}", shown) == []


def test_values_replaced_in_python_are_not_called_those_of_a_publication() -> None:
    model = two_segment()
    assert model.with_values({}).provenance == model.provenance
    assert model.with_values({"K11": 900.0}).provenance.endswith("; replaced by your values: K11")
    assert model.with_values({p.name: 1.1 * p.value for p in model.parameters}).provenance == "your values"
