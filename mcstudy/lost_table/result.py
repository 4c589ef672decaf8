"""The result of an inference as one labelled dataset, and the command's work from file to dataset."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy.errors import StoreError
from mcstudy.files.durable import PARTIAL
from mcstudy.lost_table import checks
from mcstudy.lost_table.calibration import Calibration, calibrate
from mcstudy.lost_table.contradictions import POINTS, trade_offs
from mcstudy.lost_table.design import InferenceFile
from mcstudy.lost_table.rows import KEYS, ROWS, shown
from mcstudy.lost_table.run import Inferred, claim, infer
from mcstudy.scheduler.cluster import ClusterOptions

RESULT = "result.zarr"

NOT_REPRODUCED = 0.01
"""Posterior predictive p below which a printed number counts as not reproduced."""

STATUS = "an inference about a lost table: not the paper's values"

QUANTILES = (0.05, 0.5, 0.95)


def result(file: InferenceFile, out: Path, options: ClusterOptions) -> xr.Dataset:
    """Infer what is missing and return the whole result; a finished one is read.

    Raises
    ------
    StudyChangedError: the folder belongs to another inference file.
    Interrupted: stopped; the same call resumes.
    """
    claim(file, out)
    path = out / RESULT
    if path.exists():
        return opened(out)
    found = infer(file, out, options)
    inference = file.inference
    seed, n = inference.seed, inference.realizations
    best = checks.best(found, seed, n, out, options)
    where = (seed, checks.WAVE_OF_STAND_IN, n)
    stand_in = checks.repeated(found, checks.stand_in(found), where, out, options)
    replicates = checks.replicated(found, seed)
    p = checks.tail(replicates)
    failed = [row.key for row, value in zip(ROWS, p, strict=True) if row.kind != "told" and value < NOT_REPRODUCED]
    fronts = trade_offs(found.emulator, failed, seed)
    honest = calibrate(found.prior, found.prior_bank, inference.papers, n, inference.particles, seed)
    dataset = _dataset(found, best, stand_in, replicates, p, failed, fronts, honest)
    dataset.attrs |= {"fingerprint": file.fingerprint, "studies": len(found.bank), "realizations": n}
    partial = out / f"{RESULT}{PARTIAL}"
    shutil.rmtree(partial, ignore_errors=True)
    try:
        dataset.to_zarr(partial, mode="w", consolidated=False)
        partial.replace(path)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None
    return opened(out)


def opened(out: Path) -> xr.Dataset:
    """The result in the folder of a finished inference."""
    path = out / RESULT
    if not path.is_dir():
        raise StoreError(f"{path}: expected the result of a finished inference (mcstudy infer FILE -o {out})")
    try:
        return xr.open_zarr(path, consolidated=False).load()
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None


def _dataset(
    found: Inferred,
    best: checks.Checked,
    stand_in: checks.Checked,
    replicates: np.ndarray,
    p: np.ndarray,
    failed: list[str],
    fronts: np.ndarray,
    honest: Calibration,
) -> xr.Dataset:
    prior, u = found.prior, found.posterior.u
    values, before = prior.values(u), prior.values(found.prior_bank.u)
    data = {
        "posterior": (("particle", "unknown"), values, "points of the posterior; the number of a choice"),
        "log_likelihood": (("particle",), found.posterior.log_likelihood, "log likelihood of the printed numbers"),
        "prior_quantile": (("quantile", "unknown"), _quantiles(before), "of stable bodies of the prior"),
        "posterior_quantile": (("quantile", "unknown"), _quantiles(values), "of the posterior"),
        "width": (
            ("unknown",),
            u.std(axis=0) / found.prior_bank.u.std(axis=0),
            "standard deviation of the posterior over that of the prior, on the scale of the prior",
        ),
        "best": (("unknown",), prior.values(best.u), "configuration of highest posterior density"),
        "stand_in": (("unknown",), prior.values(stand_in.u), "hand-calibrated stand-in"),
        "printed": (("row",), np.array([row.value for row in ROWS]), "number printed in the paper; 0 for a ranking"),
        "predicted": (("particle", "row"), shown(replicates), "rows of papers drawn from the posterior predictive"),
        "p": (("row",), p, "posterior predictive p of the printed number"),
        "best_rows": (("study", "row"), shown(best.columns), "rows of studies at the best configuration"),
        "best_distance": (("row",), best.distance, "of the printed number, in joint standard errors"),
        "stand_in_rows": (("study", "row"), shown(stand_in.columns), "rows of studies at the stand-in"),
        "stand_in_distance": (("row",), stand_in.distance, "of the printed number, in joint standard errors"),
        "trade_off": (("failed", "row", "point", "of"), fronts, "distances that cannot both be smaller"),
        "rank": (("paper", "unknown"), honest.rank, "share of the posterior below the true value, simulated papers"),
        "covered": (("paper", "unknown"), honest.covered, "whether the 90 % interval contains the true value"),
        "paper_width": (("paper", "unknown"), honest.width, "posterior over prior standard deviation"),
        "paper_error": (
            ("paper", "unknown"),
            honest.error,
            "distance of the posterior mean from the truth, in the cube",
        ),
        "prior_error": (("paper", "unknown"), honest.prior_error, "the same for the mean of the prior"),
    }
    coords = {
        "unknown": _words(prior.names),
        "unit": ("unknown", _words(x.unit for x in prior.unknowns)),
        "row": _words(KEYS),
        "label": ("row", _words(row.label for row in ROWS)),
        "kind": ("row", _words(row.kind for row in ROWS)),
        "quantile": list(QUANTILES),
        "failed": _words(failed),
        "point": np.arange(POINTS),
        "of": _words(("failed", "row")),
    }
    dataset = xr.Dataset(
        {name: xr.Variable(dims, x, {"long_name": text}) for name, (dims, x, text) in data.items()}, coords
    )
    dataset.attrs["status"] = STATUS
    return dataset


def _words(texts: Iterable[str]) -> np.ndarray:
    """Text of any length, which Zarr stores portably."""
    return np.array(list(texts), dtype=object)


def _quantiles(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.quantile(x, QUANTILES, axis=0))
