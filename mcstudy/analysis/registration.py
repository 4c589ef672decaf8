"""Registers ``.mc`` with xarray: on a Dataset, and on a node of a tree. The analysis is imported when it is first used.

Whatever hands over results imports this. For a file that xarray itself has opened:
``import mcstudy.analysis.registration``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    from mcstudy.analysis.accessor import MonteCarlo


@xr.register_dataset_accessor("mc")
def of_dataset(data: xr.Dataset) -> MonteCarlo:
    """``dataset.mc``."""
    from mcstudy.analysis.accessor import MonteCarlo

    return _of_sweep(data) if "cells" in data.attrs else MonteCarlo(data)


@xr.register_datatree_accessor("mc")
def of_node(node: xr.DataTree) -> MonteCarlo:
    """``tree["accuracy"].mc``."""
    from mcstudy.analysis.accessor import MonteCarloOfNode

    return _of_sweep(node.to_dataset()) if "cells" in node.attrs else MonteCarloOfNode(node)


def _of_sweep(data: xr.Dataset) -> Any:
    from mcstudy.analysis.sweep_accessor import MonteCarloOfSweep

    return MonteCarloOfSweep(data)
