"""The page of a fit shows the fit, and its figures are those that Python draws."""

from __future__ import annotations

import html
import pickle
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.exits import Exit
from mcstudy.identification import words
from mcstudy.identification.estimate import interval
from mcstudy.identification.tables import estimates
from mcstudy.recordings.frf import FrfRecording
from mcstudy.report.person.page import fit_page as page_of
from mcstudy.report.typeset import typeset


@pytest.fixture(scope="module")
def fit(lagging_recording: Path) -> mc.FitResult:
    return mc.fit(lagging_recording, fmax=2.0, effects=["sensor_lag_theta2"])


def test_the_page_holds_every_sentence_and_every_number_of_the_fit(fit_page: Path, fit: mc.FitResult) -> None:
    text = fit_page.read_text(encoding="utf-8")
    for sentence in words.sentences(fit):
        assert typeset(sentence) in html.unescape(text)
    for row in estimates(fit).rows:
        for cell in row:
            assert typeset(cell) in html.unescape(text)
    keys = re.findall(r'<figure id="(\w+)"', text)
    assert keys == ["intervals", "profile", "correlations", "frf", "sway", "information", "waterfall"]
    contents = text[text.index("<nav") : text.index("</nav>")]
    assert all(f'<a href="#{key}">' in contents for key in keys)
    first = text[: text.index("<main")]
    determined = [e for e in fit.estimates if e.verdict == "identifiable"]
    assert f"<strong>{len(determined)} of {len(fit.estimates)}</strong>" in first
    best = min((e for e in determined if e.estimate), key=lambda e: (e.high - e.low) / abs(e.estimate))
    assert interval(best) in first
    assert "http://" not in re.sub(r'xmlns="http://www.w3.org/2000/svg"', "", text)
    assert len(text.encode()) < 2e6


def test_the_page_says_which_command_made_it(fit_page: Path, lagging_recording: Path) -> None:
    text = fit_page.read_text(encoding="utf-8")
    command = f"mcstudy fit {lagging_recording} --fmax 2.0 --with sensor_lag_theta2 --html {fit_page}"
    assert text.count(f"Made by <code>{command}</code>") == text.count("<figure ")


def test_every_call_that_the_page_prints_draws_its_figure(fit_page: Path, fit: mc.FitResult) -> None:
    calls = re.findall(r"in Python <code>(.*?)</code>", fit_page.read_text(encoding="utf-8"))
    assert len(calls) == 7
    for call in calls:
        axes = eval(html.unescape(call), {"fit": fit})
        assert axes.get_lines() or axes.patches or axes.collections, call
        plt.close(axes.figure)


def test_a_profile_is_drawn_as_it_is_and_below_its_threshold(fit: mc.FitResult) -> None:
    axes = fit.plot.profile("K12")
    x, y = axes.get_lines()[0].get_data()
    np.testing.assert_array_equal(x, fit["K12"].profile.value)
    threshold = axes.get_lines()[1].get_ydata()[0]  # type: ignore[index]
    assert np.max(np.asarray(y)) <= threshold
    plt.close(axes.figure)
    with pytest.raises(mc.InputError, match="expected one of K11"):
        fit.plot.profile("nothing")


def test_the_fitted_response_passes_through_the_measured_one(fit: mc.FitResult) -> None:
    axes = fit.plot.response_gain(angle=0)
    measured, curve = (line.get_data() for line in axes.get_lines()[:2])
    at = np.interp(np.log(measured[0]), np.log(curve[0]), np.log(curve[1]))
    assert np.median(np.abs(np.log(measured[1]) - at)) < 0.15
    plt.close(axes.figure)


def test_a_published_response_has_a_page_without_sway(fit: mc.FitResult) -> None:
    lines = fit.lines
    other = mc.fit(FrfRecording(lines.f, lines.y, lines.noise.C), fmax=2.0)
    text = page_of(other)
    assert '<figure id="frf"' in text
    assert '<figure id="sway"' not in text
    with pytest.raises(mc.InputError, match="time series"):
        other.plot.sway()


def test_a_fit_with_figures_can_be_pickled(fit: mc.FitResult) -> None:
    assert fit.plot
    assert pickle.loads(pickle.dumps(fit)).theta.tolist() == fit.theta.tolist()


def test_a_page_that_cannot_be_written_is_one_line(
    lagging_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    place = tmp_path / "file" / "page.html"
    assert main(["fit", str(lagging_recording), "--fmax", "1.2", "--html", str(place)]) == Exit.BAD_INPUT
    assert "page.html: cannot be written: " in capsys.readouterr().err
