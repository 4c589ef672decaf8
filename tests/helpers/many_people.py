"""The FRFs of 49 people (COMTEST), which are no part of the project: tests of them skip where they are not at hand."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr

from mcstudy.recordings.frf_group import read_frf_group

ROOT = Path(__file__).parents[2]
COMTEST = ROOT.parent / "shared" / "real" / "comtest"

needs_comtest = pytest.mark.skipif(
    not COMTEST.is_dir(), reason="the FRFs of 49 people (COMTEST) are not in ../shared/real/comtest"
)


def comtest() -> xr.Dataset:
    """The group, as `pipelines/recordings/comtest.toml` describes it."""
    return read_frf_group(ROOT / "pipelines" / "recordings" / "comtest.toml", data=COMTEST)
