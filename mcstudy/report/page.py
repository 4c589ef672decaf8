"""The page of a study: one self-contained HTML file that needs no network.

Apart from `mcstudy.report.study_page`, because a page that is kept needs neither statistics nor matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from mcstudy.analysis.kept import looking
from mcstudy.files.local_path import local_path
from mcstudy.report.document import write_page
from mcstudy.study.settled import settled

DATA = (".zarr", ".nc", ".toml", ".csv")
"""Endings that a page has .html instead of."""


def write_report(out: str | Path, page: str | Path | None = None, *, beside: Sequence[str | Path] = ()) -> Path:
    """Write a results cube, complete or not, as one self-contained HTML page with every table and figure.

    Parameters
    ----------
    out
        Path of the cube.
    page
        Path of the page; beside the cube, with its name, when None.
    beside
        Further results to include: paths of cubes, or of files of the alternatives that the paper discusses.

    Returns
    -------
    pathlib.Path
        The page. It is drawn once and kept, unless it shows alternatives.

    Raises
    ------
    StoreError
        A file is neither a cube nor an alternative.
    InputError
        matplotlib is missing, or the page cannot be written.
    """
    cube, others = local_path(out), [local_path(file) for file in beside]
    return write_page(default_page(cube) if page is None else page, lambda: page_of(cube, others))


def page_of(path: str | Path, beside: Sequence[Path] = ()) -> str:
    """The text of that page; see `write_report`."""
    path = local_path(path)
    return settled([path, *beside], lambda: _page(path, beside))


def default_page(file: Path) -> Path:
    """The page of a cube or a recording when no other is asked for: ``results/a.zarr`` has ``results/a.html``."""
    return file.with_name(f"{file.stem if file.suffix in DATA else file.name}.html")


def _page(path: Path, beside: Sequence[Path]) -> str:
    with ExitStack() as looks:
        look = looks.enter_context(looking(path))

        def drawn() -> dict[str, str]:
            from mcstudy.report.style import require_matplotlib

            require_matplotlib()
            from mcstudy.report.study_page import study_page

            return {"html": study_page(path, beside, looks, look)}

        return str((drawn() if beside else look.kept("page", [str(path)], drawn))["html"])
