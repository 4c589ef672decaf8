"""Monte Carlo studies of identifiability, and diagnosis of the gap between model and body."""

from __future__ import annotations

TYPE_CHECKING = False  # importing `typing` for it would take longer than all else until the command hears Ctrl-C
if TYPE_CHECKING:
    from typing import Any

    from mcstudy.study.results import open_results

    __version__: str

__all__ = ["__version__", "open_results"]


def __getattr__(name: str) -> Any:
    # Imported when asked for: the command line's help must not wait for xarray, Dask and numba.
    if name == "open_results":
        from mcstudy.study.results import open_results

        return open_results
    if name == "__version__":
        from importlib.metadata import version

        return version("mcstudy")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
