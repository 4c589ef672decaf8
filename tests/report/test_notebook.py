"""Figures in a notebook, in a real kernel: all of them are shown, and the user's settings stay."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Empty
from typing import Any

import pytest

pytest.importorskip("ipykernel", reason="no Jupyter kernel")

from jupyter_client.manager import start_new_kernel

Run = Callable[[str], list[dict[str, Any]]]
PATIENCE_S = 180


@pytest.fixture
def run() -> Iterator[Run]:
    """Executes a cell in a new kernel; returns what it displays, by MIME type."""
    manager, client = start_new_kernel(kernel_name="python3")

    def cell(code: str) -> list[dict[str, Any]]:
        asked, shown = client.execute(code), []
        while True:
            try:
                message = client.get_iopub_msg(timeout=PATIENCE_S)
            except Empty:
                raise TimeoutError(code) from None
            kind, content = message["msg_type"], message["content"]
            if message["parent_header"].get("msg_id") != asked:
                continue
            assert kind != "error", content
            if kind in ("display_data", "execute_result"):
                shown.append(content["data"])
            if kind == "status" and content["execution_state"] == "idle":
                return shown

    yield cell
    client.stop_channels()
    manager.shutdown_kernel(now=True)


def images(shown: list[dict[str, Any]]) -> int:
    return sum("image/png" in data for data in shown)


def test_every_figure_of_a_kernel_is_shown_ours_and_the_users(run: Run, paper_cube: Path) -> None:
    """The first one is ours: the kernel begins to show figures when the first is made."""
    run(f"""
import mcstudy as mc
from mcstudy.report import figures
cube = mc.open_results({str(paper_cube)!r})["accuracy"]
recording = mc.simulate(seed=1, cycles=3)
diagnosis = mc.diagnose(recording, fast=True)
""")
    run("import matplotlib; before = dict(matplotlib.rcParams)")
    cells = [
        "figures.parameter_bars(cube, 'K11')",
        "figures.starts_curve(cube)",
        "diagnosis.plot.misfit_gain(angle=1)",
        "import matplotlib.pyplot as plt; plt.plot([1, 2])",
        "figures.cv_bars(cube)",
        "fig, ax = plt.subplots(); figures.cv_bars(cube, ax=ax)",
        "plt.figure(); plt.plot([1, 2], [3, 4])",
    ]
    assert [images(run(code)) for code in cells] == [1] * len(cells)
    shown = run(
        "{k: (before[k], v) for k, v in matplotlib.rcParams.items() "
        "if before[k] != v and k not in ('interactive', 'backend')}"
    )
    assert shown[0]["text/plain"] == "{}"


def test_our_figure_changes_no_setting_of_a_user() -> None:
    import matplotlib

    from mcstudy.report.axes import axes

    before = dict(matplotlib.rcParams)
    ax = axes(None)
    assert dict(matplotlib.rcParams) == before
    assert ax.figure.get_facecolor() == matplotlib.colors.to_rgba("#fefefe")
    import matplotlib.pyplot as plt

    plt.close(ax.figure)
