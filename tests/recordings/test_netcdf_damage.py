"""NetCDF recordings with changed bytes: what is read is right, or one line says why not; nothing hangs or crashes.

A changed byte of a number or of an attribute cannot be seen where a file keeps no checksums; where it does
(``compressed``), no other values may come. ``MCSTUDY_FUZZ=300`` tries 300 changes of every kind on every form; with
``-s`` it prints what came.
"""

from __future__ import annotations

import collections
import os
import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from fuzzing import MANY

from mcstudy.errors import InputError
from mcstudy.files import reading_process
from mcstudy.recordings.formats.netcdf_zarr import read_dataset, to_dataset
from mcstudy.recordings.recording import Recording, Trial

COUNT = int(os.environ.get("MCSTUDY_FUZZ", "25"))
"""Changes of every kind."""

FORMS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    "as written": lambda d, path: d.to_netcdf(path, engine="h5netcdf"),
    "compressed": lambda d, path: d.to_netcdf(
        path, engine="h5netcdf", encoding={n: {"zlib": True, "fletcher32": True} for n in d.data_vars}
    ),
    "packed": lambda d, path: d.to_netcdf(
        path, engine="h5netcdf", encoding={"theta": {"dtype": "i2", "scale_factor": 1e-3, "_FillValue": -(2**15)}}
    ),
}


def sway() -> Recording:
    rng = np.random.default_rng(0)
    trials = tuple(Trial(rng.standard_normal(n), rng.standard_normal((n, 2)), 5.0) for n in (64, 48))
    return Recording(trials, 10.0, 1.6)


@pytest.fixture(scope="module", params=FORMS)
def honest(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("honest") / "a.nc"
    FORMS[request.param](to_dataset(sway()), path)
    return path


def single(rng: random.Random, raw: bytearray) -> bytes:
    """One byte; half of the time zero or all bits."""
    raw[rng.randrange(len(raw))] = rng.choice([0, 255, rng.randrange(256), rng.randrange(256)])
    return bytes(raw)


def run(rng: random.Random, raw: bytearray) -> bytes:
    """Up to 32 bytes in a row."""
    at, n = rng.randrange(len(raw)), rng.randint(2, 32)
    raw[at : at + n] = rng.choice([bytes(n), b"\xff" * n, rng.randbytes(n)])[: len(raw[at : at + n])]
    return bytes(raw)


def cut(rng: random.Random, raw: bytearray) -> bytes:
    return bytes(raw[: rng.randrange(len(raw))])


def splice(rng: random.Random, raw: bytearray) -> bytes:
    """A piece of the file in another place, over what was there or pushed in."""
    start, n, at = rng.randrange(len(raw)), rng.randint(1, 600), rng.randrange(len(raw))
    piece = raw[start : start + n]
    raw[at : at + rng.choice([0, len(piece)])] = piece
    return bytes(raw)


def outcome(path: Path) -> str:
    """What came of reading a file: the same recording, another one, or why not; raises what is no refusal."""
    began = time.process_time()
    try:
        found, said = read_dataset(path), ""
    except InputError as error:
        found, said = None, str(error)
    assert time.process_time() - began < 5
    assert "\n" not in said
    if found is None:
        assert str(path) in said
        return next((word for word in ("of computing", "fault of the library", "memory") if word in said), "refused")
    expected = sway()
    for trial in found.trials:
        assert trial.theta.shape == (*trial.stimulus.shape, 2)
    trials = zip(found.trials, expected.trials, strict=False)
    if len(found.trials) != len(expected.trials) or any(a.samples != b.samples for a, b in trials):
        return "other lengths"
    pairs = [(a, b) for a, b in zip(found.trials, expected.trials, strict=True)]
    wrong = [np.sum(np.abs(x - y) > 1e-3) for a, b in pairs for x, y in ((a.stimulus, b.stimulus), (a.theta, b.theta))]
    if sum(wrong):
        return f"other values ({'some' if sum(wrong) <= 8 else 'many'})"
    same = (found.rate_hz, found.period_s, found.stimulus, found.body) == (10.0, 1.6, expected.stimulus, expected.body)
    return "same" if same else "other attributes"


@pytest.mark.parametrize("change", [single, run, cut, splice])
def test_a_damaged_netcdf_file_is_read_or_refused_in_one_line(
    tmp_path: Path,
    honest: Path,
    change: Callable[[random.Random, bytearray], bytes],
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.setattr(reading_process, "LEAST_S", 1.0)
    raw, rng, counts = honest.read_bytes(), random.Random(0 if not MANY else None), collections.Counter[str]()
    for k in range(COUNT):
        path = tmp_path / "a.nc"
        path.unlink(missing_ok=True)
        path.write_bytes(change(rng, bytearray(raw)))
        found = outcome(path)
        counts[found] += 1
        assert not ("compressed" in request.node.name and found.startswith("other values"))
        if (keep := os.environ.get("MCSTUDY_FUZZ_KEEP")) and found not in ("same", "refused"):
            (Path(keep) / f"{request.node.name}_{k}_{found}.nc").write_bytes(path.read_bytes())
    if MANY:
        print(request.node.name, dict(counts), file=sys.__stderr__)


def test_the_undamaged_files_are_read(honest: Path) -> None:
    assert outcome(honest) == "same"
