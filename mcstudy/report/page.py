"""The page of a study: one self-contained HTML file that needs no network.

Apart from `mcstudy.report.study.page`, because a page that is kept needs neither statistics nor matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from mcstudy.analysis.cache import looking
from mcstudy.files.local_path import local_path
from mcstudy.study.cube.replacement import settled


def page(path: str | Path, beside: Sequence[Path] = ()) -> str:
    """The page of the cube at ``path``, complete or not.

    ``beside``: alternatives to show too, each a cube or a file that an installed publication reads.

    It is drawn once and kept (`mcstudy.analysis.cache`), unless it shows alternatives.
    Raises `StoreError` for a file that is neither, `InputError` where matplotlib is missing.
    """
    path = local_path(path)
    return settled([path, *beside], lambda: _page(path, beside))


def _page(path: Path, beside: Sequence[Path]) -> str:
    with ExitStack() as looks:
        look = looks.enter_context(looking(path))

        def drawn() -> dict[str, str]:
            from mcstudy.report.style import require_matplotlib

            require_matplotlib()
            from mcstudy.report.study.page import study_page

            return {"html": study_page(path, beside, looks, look)}

        return str((drawn() if beside else look.kept("page", [str(path)], drawn))["html"])
