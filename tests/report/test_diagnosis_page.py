"""The page of a diagnosis shows the diagnosis, and the recording as it was diagnosed."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from mcstudy.cli import main
from mcstudy.effect_library.library import LIBRARY
from mcstudy.errors import InputError
from mcstudy.exits import Exit
from mcstudy.fitting.problem import Data
from mcstudy.gap.diagnose import diagnose
from mcstudy.gap.settings import FAST
from mcstudy.gap.tables import SHOWN, tables
from mcstudy.gap.verdict import differing_tests, p_words, sentences
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording
from mcstudy.report.diagnosis.data import GapData
from mcstudy.report.diagnosis.outcome_figures import cause_bars, effect_sizes
from mcstudy.report.diagnosis.page import gap_page as page_of
from mcstudy.report.diagnosis.sections import which_figures
from mcstudy.report.diagnosis.traces import SwayTraces
from mcstudy.report.figure import Figure
from mcstudy.report.frame import place
from mcstudy.report.svg import drawn, style
from mcstudy.report.typeset import typeset
from mcstudy.results.diagnosis import Diagnosis


@pytest.fixture(scope="module")
def recording(lagging_recording: Path) -> Recording:
    read = read_recording(lagging_recording)
    assert isinstance(read, Recording)
    return read


@pytest.fixture(scope="module")
def diagnosis(recording: Recording) -> Diagnosis:
    return Diagnosis.of(diagnose(recording, FAST))


@pytest.fixture(scope="module")
def data(diagnosis: Diagnosis) -> GapData:
    return GapData(diagnosis)


def test_one_command_prints_a_diagnosis_and_writes_its_page(
    gap_page: Path, lagging_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / gap_page.name
    assert main(["gap", "diagnose", str(lagging_recording), "--fast", "--html", str(page)]) == Exit.DONE
    assert "Most likely cause" in capsys.readouterr().out
    assert page.read_text(encoding="utf-8").replace(str(page), str(gap_page)) == gap_page.read_text(encoding="utf-8")


def test_the_page_holds_the_verdict_and_every_part_of_the_diagnosis(gap_page: Path, diagnosis: Diagnosis) -> None:
    text = gap_page.read_text(encoding="utf-8")
    for sentence in sentences(diagnosis):
        assert typeset(f"<p>{sentence}</p>") in html.unescape(text)
    contents = text[text.index("<nav") : text.index("</nav>")]
    keys = re.findall(r'<figure id="(\w+)"', text)
    assert keys == ["evidence", "frf", "misfit", "zmap", "causes", "closed", "traces"]
    for key in keys:
        assert f'<a href="#{key}">' in contents, key
    shown = [c for c in diagnosis.causes if c.probability >= SHOWN]
    assert shown
    for cause in shown:
        assert f"{cause.probability:.3f}" in text
    assert diagnosis.closed is not None
    assert f"[{100 * diagnosis.closed.low:.0f}, {100 * diagnosis.closed.high:.0f}]" in text
    for t in tables(diagnosis):
        assert text.count(f"<caption><span>{html.escape(t.title)}</span></caption>") == 1
    for e in LIBRARY.values():
        assert typeset(html.escape(e.source)) in text
    assert len(text.encode()) < 3e6
    assert "http://" not in re.sub(r'xmlns="http://www.w3.org/2000/svg"', "", text)


@pytest.mark.parametrize(
    ("shape", "lines", "why"), [(0.001, 0.36, "can be lost"), (0.3, 0.02, "looks only along"), (0.001, 0.002, "")]
)
def test_two_tests_that_differ_are_both_named(diagnosis: Diagnosis, shape: float, lines: float, why: str) -> None:
    d = replace(diagnosis, detection=replace(diagnosis.detection, p_value=shape, fit_p_value=lines))
    said = differing_tests(d)
    assert bool(said) == bool(why)
    if why:
        assert why in said
        least = 1 / (1 + d.detection.draws)
        assert f"deviations of known shape, {p_words(shape, least)}" in said
        assert f"residual of all lines, {p_words(lines, least)}" in said
        assert typeset(f"<p>{html.escape(said)}</p>") in page_of(d)


def test_long_names_of_causes_do_not_run_into_each_other(diagnosis: Diagnosis) -> None:
    pair = replace(
        diagnosis.causes[0],
        effects=("passive_damping_ankle", "short_latency_reflex"),
        probability=0.1,
        alternatives=(("passive_damping_ankle",), ("short_latency_reflex", "stimulus_delay", "stimulus_lag")),
    )
    figure = plt.figure(figsize=(4.3, 4.4), layout="constrained")
    ax = cause_bars(replace(diagnosis, causes=(pair,) * 5), figure.add_subplot())
    figure.canvas.draw()
    boxes = sorted((label.get_window_extent() for label in ax.get_yticklabels()), key=lambda box: box.y0)
    plt.close(figure)
    assert all(upper.y0 > lower.y1 for lower, upper in pairwise(boxes))


@pytest.mark.parametrize("sizes", [(4.85, -3.49, -2.34), (-221.0,), (221.0, -0.05), (-1234.0, 2.1)])
def test_the_label_of_a_size_touches_neither_the_line_at_zero_nor_the_edge(
    diagnosis: Diagnosis, sizes: tuple[float, ...]
) -> None:
    leading = diagnosis.leading
    assert leading is not None
    size = replace(leading.sizes[0], se=1.0)
    shown = tuple(replace(size, estimate=x, low=x - 1.96, high=x + 1.96) for x in sizes)
    cause = replace(leading, sizes=shown)
    d = replace(diagnosis, causes=(cause,), credible_set=(0,))
    with style():
        ax = drawn(lambda ax: effect_sizes(d, ax))
        for text in ax.texts:
            text.set_text(text.get_text().replace("-", "−"))  # as on the page, and wider
        renderer = ax.figure.canvas.get_renderer()  # type: ignore[union-attr,attr-defined]
        place(ax, renderer)
    frame, zero = ax.get_window_extent(renderer), ax.transData.transform((0, 0))[0]
    boxes = [t.get_window_extent(renderer) for t in ax.texts]
    assert len(boxes) == len(sizes)
    for x, box in zip(sizes, boxes, strict=True):
        assert frame.x0 < box.x0 < box.x1 < frame.x1
        assert box.x1 < zero if x < 0 else box.x0 > zero


def test_every_figure_says_which_command_made_it(gap_page: Path, lagging_recording: Path) -> None:
    text = gap_page.read_text(encoding="utf-8")
    command = f"mcstudy gap report {lagging_recording} --fast -o {gap_page}"
    assert text.count(f"Made by <code>{command}</code>") == text.count("<figure ")


def test_the_model_before_is_the_one_whose_misfit_was_tested(data: GapData, diagnosis: Diagnosis) -> None:
    lines = Data.of(data.lines)
    r = np.einsum("nij,nj->ni", lines.weight, data.lines.y - data.before(data.lines.f))
    assert (np.abs(r) ** 2).sum() == pytest.approx(diagnosis.detection.chi2, rel=1e-9)


def test_the_true_cause_takes_the_residuals_down_to_noise(data: GapData) -> None:
    assert data.z_after is not None
    before, after = (np.sqrt(np.mean(z**2)) for z in (data.z_before, data.z_after))
    assert before > 1.2
    assert after == pytest.approx(1.0, abs=0.15)


def test_averages_scatter_about_the_model_after_as_their_errors_say(data: GapData) -> None:
    a = data.averages
    z = np.abs(a.ratio - a.after) / a.sd
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.35)
    assert np.sqrt(np.mean((np.abs(a.ratio - 1) / a.sd) ** 2)) > 1.5


def test_phases_of_a_panel_follow_one_another_without_jumps(data: GapData) -> None:
    """The base model is half a turn away at low frequencies; the branch of a phase is free, its value is not."""
    f = np.geomspace(data.lines.f[0], data.lines.f[-1], 400)
    after = data.after(f)
    assert after is not None
    for angle in range(2):
        phases = data.phases(f, angle)
        assert phases.added is not None
        for curve, response in ((phases.base, data.before(f)), (phases.added, after)):
            assert np.abs(np.diff(curve)).max() < np.pi
            np.testing.assert_allclose(np.exp(1j * curve), (response / np.abs(response))[:, angle], atol=1e-9)
        assert abs((phases.base - phases.added).mean()) <= np.pi
        a = data.averages
        assert np.abs(phases.measured - np.interp(a.f, f, phases.added)).max() < 1.1 * np.pi
        turned = phases.measured - np.interp(a.f, f, phases.base)
        np.testing.assert_allclose(np.exp(1j * turned), (a.ratio / np.abs(a.ratio))[:, angle], atol=1e-9)
    alone = GapData(replace(data.diagnosis, detected=False, closed=None)).phases(f, 0)
    assert alone.added is None
    assert np.abs(np.diff(alone.measured)).max() < 2 * np.pi


def test_a_cause_that_leaves_the_mean_response_alone_has_no_share_to_show(diagnosis: Diagnosis) -> None:
    cause = replace(
        diagnosis.causes[0], effects=("gain_drift",), alternatives=(("gain_drift",),), fitted=diagnosis.base
    )
    drifting = replace(diagnosis, causes=(cause, *diagnosis.causes[1:]), closed=None)
    closing = which_figures(drifting)[1]
    assert isinstance(closing, Figure)
    assert [p.title for p in closing.panels] == ["error of predicted sway"]
    assert "no share of the gap closed" in " ".join(closing.text)


def test_errors_of_predicted_sway_are_those_of_the_diagnosis(data: GapData, diagnosis: Diagnosis) -> None:
    """In time as in frequency, up to lines that the stimulus excites too little to be diagnosed."""
    traces = SwayTraces.of(data)
    assert traces.after is not None
    for predicted, stage in ((traces.before, "before"), (traces.after, "after")):
        error = np.sqrt(((traces.measured - predicted) ** 2).sum(axis=1).mean())
        assert error == pytest.approx(diagnosis.sway_rms_deg[stage], rel=0.15), stage


def test_the_true_cause_leaves_of_sway_what_noise_leaves(data: GapData) -> None:
    traces = SwayTraces.of(data)
    assert traces.after is not None
    left = np.sqrt(np.mean((traces.measured - traces.after) ** 2, axis=0))
    assert (left < 4 * traces.error).all()
    assert (np.sqrt(np.mean((traces.measured - traces.before) ** 2, axis=0)) > 2 * left).any()


def test_without_a_period_predicted_sway_follows_the_measured_one(recording: Recording) -> None:
    aperiodic = replace(recording, period_s=None)
    traces = SwayTraces.of(GapData(diagnose(aperiodic, FAST)))
    assert traces.after is not None
    for k in range(2):
        before, after = (np.corrcoef(traces.measured[:, k], x[:, k])[0, 1] for x in (traces.before, traces.after))
        assert after > max(before, 0.7)


def test_a_figure_that_a_diagnosis_cannot_fill_is_refused_in_one_line(diagnosis: Diagnosis) -> None:
    bare = replace(diagnosis, recording=None, closed=None, sway_rms_deg=dict.fromkeys(diagnosis.sway_rms_deg))
    plot = bare.plot
    for draw, message in (
        (plot.sway, "expected a diagnosis of time series, got one of lines alone"),
        (plot.gap_closed, "expected a cause that was added"),
        (plot.sway_error, "expected a diagnosis of time series"),
    ):
        with pytest.raises(InputError, match=message):
            draw()


def test_every_call_that_the_page_prints_draws_its_figure(gap_page: Path, diagnosis: Diagnosis) -> None:
    calls = re.findall(r"in Python <code>(.*?)</code>", gap_page.read_text(encoding="utf-8"))
    assert len(calls) == 7
    for call in calls:
        axes = eval(html.unescape(call), {"diagnosis": diagnosis})
        assert axes.get_lines() or axes.patches, call
        plt.close(axes.figure)


def test_a_published_frf_has_a_page_without_sway(data: GapData) -> None:
    text = page_of(diagnose(FrfRecording(data.lines.f, data.lines.y, data.lines.noise.C), FAST))
    assert "published FRF" in text
    assert '<figure id="zmap"' in text
    assert '<figure id="traces"' not in text


def test_a_page_that_cannot_be_written_is_told_before_the_diagnosis(
    lagging_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["gap", "report", str(lagging_recording), "-o", str(tmp_path / "file" / "page.html")]) == Exit.BAD_INPUT
    assert "page.html: cannot be written: " in capsys.readouterr().err
