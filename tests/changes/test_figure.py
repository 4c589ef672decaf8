"""A new figure of a study's page is a panel, its name, and its caption; its numbers are read from what is drawn."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from changes import Copy
from tiny_studies import EIGHT_FITS

PANEL = '''"""Iterations of the fits."""

from __future__ import annotations

from matplotlib.axes import Axes

from mcstudy.report.axes import axes
from mcstudy.report.figures.common import GroupLike, chosen_amplitude, chosen_fmax, view_of


def iterations_by_start(data: GroupLike, amplitude: float | None = None, fmax: float | None = None,
                        ax: Axes | None = None) -> Axes:
    """Iterations of every start, mean over realizations."""
    view, ax = view_of(data), axes(ax)
    cube = view.cube.sel(amplitude=chosen_amplitude(view, amplitude), fmax=chosen_fmax(view, fmax))
    mean = cube["iterations"].mean("realization")
    ax.plot(range(1, mean.size + 1), mean.values, "o", label="mean over realizations")
    ax.set_xlabel("start")
    ax.set_ylabel("iterations")
    return ax
'''

CAPTION = '''

def iterations_figure(context: Context) -> Figure:
    """Iterations of every start."""
    view = context.main
    return Figure(
        "iterations",
        "Iterations of every start",
        ["Mean over realizations of the iterations of each start."],
        [Panel("iterations", partial(figures.iterations_by_start, view, None, None))],
        python=f'figures.iterations_by_start(tree["{view.name}"])',
    )
'''

LOOK = """
import json
import mcstudy as mc
from mcstudy.cli import main
from mcstudy.report import figures

tree = mc.run("study.toml", "out.zarr", workers=1)
(group,) = tree.children
main(["report", "out.zarr", "-o", "page.html"])
drawn = figures.iterations_by_start(tree[group]).lines[0].get_ydata().tolist()
expected = tree[group].to_dataset()["iterations"].isel(amplitude=-1, fmax=-1).mean("realization").values.tolist()
print(json.dumps({"page": open("page.html").read(), "drawn": drawn, "expected": expected}))
"""


def test_a_figure_of_a_study_is_a_panel_its_name_and_its_caption(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    copy = Copy(tmp_path / "copy")
    copy.add("mcstudy/report/figures/iterations.py", PANEL)
    names, search = "mcstudy/report/figures/__init__.py", "mcstudy/report/study/search.py"
    copy.edit(
        names, "\n__all__ = [", "\nfrom mcstudy.report.figures.iterations import iterations_by_start\n\n__all__ = ["
    )
    copy.edit(names, '    "parameter_bars",', '    "iterations_by_start",\n    "parameter_bars",')
    copy.edit(search, "one_start(context)]", "one_start(context), iterations_figure(context)]")
    text = (copy.folder / search).read_text(encoding="utf-8")
    copy.edit(search, text[-40:], text[-40:] + CAPTION)
    (copy.folder / "study.toml").write_text(EIGHT_FITS, encoding="utf-8")
    found = json.loads(copy.run(LOOK).rstrip().rsplit("\n", 1)[-1])
    assert found["drawn"] == pytest.approx(found["expected"])
    figure = re.search(r'<figure id="iterations".*?</figure>', found["page"], re.DOTALL)
    assert figure is not None
    assert "Mean over realizations of the iterations of each start." in figure[0]
    assert '<a href="#iterations">Iterations of every start</a>' in found["page"]
    data = re.search(r'class="readings">(.*?)</script>', figure[0])
    assert data is not None
    (series,) = json.loads(data[1])[0]["series"]
    assert series["n"] == "mean over realizations"
    assert series["y"] == pytest.approx(found["expected"], rel=1e-3)
    assert len(copy.touched) == 3
