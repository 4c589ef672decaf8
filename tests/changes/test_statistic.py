"""A new statistic is a function and its declaration: method, table, JSON and a figure of the page follow."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from changes import Copy
from tiny_studies import EIGHT_FITS

FUNCTION = '''"""How far apart the costs of the best fits lie."""

from __future__ import annotations

import xarray as xr

from mcstudy.analysis.labels import labelled
from mcstudy.analysis.montecarlo import jackknife


def cost_spread(cells: xr.Dataset) -> xr.Dataset:
    """Standard deviation of the cost of the best fits over realizations: dims (amplitude, fmax)."""
    found = jackknife(cells["cost"], xr.DataArray(0.0), lambda m: m.sd)
    return labelled(found, cells, "standard deviation of the cost of the best fits")
'''

DECLARATION = """    CellStatistic(
        key="cost_spread",
        function="mcstudy.analysis.cost_spread:cost_spread",
        head="SD cost",
        page="SD of the cost",
        meaning="standard deviation of the cost over realizations",
        figure="Spread of the cost",
    ),
)
\"\"\"In the order of the columns.\"\"\"
"""

LOOK = """
import json
import mcstudy as mc
from mcstudy.cli import main

tree = mc.run("study.toml", "out.zarr", workers=1)
group = next(iter(tree.children.values()))
assert "Standard deviation of the cost of the best fits" in group.mc.cost_spread.__doc__
cells = group.mc.best()
main(["show", "out.zarr", "--all"])
main(["report", "out.zarr", "-o", "page.html"])
data = mc.summary(tree).to_dict()
(shown,) = [g for g in data["groups"].values()]
print(json.dumps({
    "page": open("page.html").read(),
    "method": group.mc.cost_spread()["value"].values.ravel().tolist(),
    "expected": cells["cost"].std("realization", ddof=1).values.ravel().tolist(),
    "json": [c["cost_spread"]["value"] for c in shown["cells"]],
}))
"""


def test_a_statistic_is_a_function_and_its_declaration(tmp_path: Path) -> None:
    copy = Copy(tmp_path / "copy")
    copy.add("mcstudy/analysis/cost_spread.py", FUNCTION)
    copy.edit("mcstudy/analysis/statistics.py", ')\n"""In the order of the columns."""\n', DECLARATION)
    (copy.folder / "study.toml").write_text(EIGHT_FITS, encoding="utf-8")
    shown, result = copy.run(LOOK).rstrip().rsplit("\n", 1)
    found = json.loads(result)
    assert found["method"] == found["json"] == pytest.approx(found["expected"], rel=1e-12)
    assert "SD cost" in shown
    assert "SD cost: standard deviation of the cost over realizations." in shown
    assert '<figure id="cost_spread"' in found["page"]
    assert "SD of the cost" in found["page"]
    assert len(copy.touched) == 2
