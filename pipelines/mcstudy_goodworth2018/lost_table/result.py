"""The result of an inference as one labelled dataset, and the command's work from file to dataset."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy import program
from mcstudy.errors import StoreError
from mcstudy.files.durable import PARTIAL
from mcstudy.files.unfinished import unfinished
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.streams import stream
from mcstudy_goodworth2018.lost_table import checks
from mcstudy_goodworth2018.lost_table.bank import Bank, simulated
from mcstudy_goodworth2018.lost_table.calibration import LEVELS, POWERS
from mcstudy_goodworth2018.lost_table.checks import rows_of
from mcstudy_goodworth2018.lost_table.contradictions import POINTS, trade_offs
from mcstudy_goodworth2018.lost_table.design import InferenceFile
from mcstudy_goodworth2018.lost_table.emulator import Emulator
from mcstudy_goodworth2018.lost_table.posterior import THOROUGH, Likelihood, tempered
from mcstudy_goodworth2018.lost_table.rows import KEYS, ROWS, shown, stated
from mcstudy_goodworth2018.lost_table.run import Inferred, claim, infer
from mcstudy_goodworth2018.lost_table.search import promising

RESULT = "result.zarr"

FIRST_WAVE_OF_AIMED = 301

NOT_REPRODUCED = 0.01
"""Posterior predictive p below which a printed number counts as not reproduced."""

STATUS = "an inference about a lost table: not the paper's values"

QUANTILES = (0.05, 0.5, 0.95)


def result(file: InferenceFile, out: Path, options: ClusterOptions) -> xr.Dataset:
    """Infer what is missing and return the whole result; a finished one is read, whichever program made it.

    Raises
    ------
    StudyChangedError: the folder belongs to another inference file, or another program has begun it.
    Interrupted: stopped; the same call resumes.
    """
    path = out / RESULT
    claim(file, out, finished := path.exists())
    if finished:
        return opened(out)
    found = infer(file, out, options)
    inference = file.inference
    seed, n = inference.seed, inference.realizations
    best = checks.best(found.prior, found.bank, found.stand_in.error, (seed, n), out, options)
    replicates = checks.replicated(found.emulator, found.posterior.u, seed)
    p = checks.tail(replicates)
    missed = [
        row.key
        for row, value, agrees in zip(ROWS, p, best.agrees, strict=True)
        if row.kind != "told" and (value < NOT_REPRODUCED or not agrees)
    ]
    bank = _aimed(found, missed, file, out, options)
    fronts = trade_offs(rows_of(found.prior, bank), found.stand_in.error, missed)
    given_others = np.array([_given_others(found, key, inference.particles, seed) for key in missed])
    dataset = _dataset(found, best, replicates, p)
    dataset = dataset.merge(_contradictions(found, bank, missed, given_others, fronts))
    dataset.attrs |= {
        "fingerprint": file.fingerprint,
        "program": json.dumps(program.maker("mcstudy_goodworth2018")),
        "studies": len(bank),
        "realizations": n,
        "power": found.power,
    }
    partial = out / f"{RESULT}{PARTIAL}"
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with unfinished(partial, partial.mkdir):
            dataset.to_zarr(partial, mode="w", consolidated=False)
            partial.replace(path)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None
    return opened(out)


def _aimed(found: Inferred, missed: Sequence[str], file: InferenceFile, out: Path, options: ClusterOptions) -> Bank:
    """The bank with the studies that aim at each missed row."""
    seed, n = file.inference.seed, file.inference.realizations
    bank = found.bank
    for key in missed if file.inference.aimed else ():
        aim = KEYS.index(key)
        rng = stream(seed, "table_aimed", aim)
        emulator = Emulator.of(found.prior, found.bank, n)
        u = promising(found.prior, found.bank, emulator, found.stand_in.error, rng, file.inference.aimed, aim)
        bank = bank.joined(simulated(found.prior, u, (seed, FIRST_WAVE_OF_AIMED + aim, n), out / "bank", options))
    return bank


def _given_others(found: Inferred, key: str, particles: int, seed: int) -> float:
    """Posterior predictive p of a row when all other rows are used and it is not."""
    likelihood = Likelihood.of(found.emulator, stated(), leave_out=(key,))
    rng = stream(seed, "table_without", KEYS.index(key))
    u = next(tempered(likelihood, rng, particles, (found.power,), moves=THOROUGH)).u
    return float(checks.tail(checks.replicated(found.emulator, u, seed))[KEYS.index(key)])


def _contradictions(
    found: Inferred, bank: Bank, missed: list[str], given_others: np.ndarray, fronts: tuple[np.ndarray, np.ndarray]
) -> xr.Dataset:
    pairs, many = fronts
    rows = rows_of(found.prior, bank)
    data = {
        "p_given_others": (("missed",), given_others, "posterior predictive p of the number when the others are used"),
        "trade_off": (("missed", "row", "point", "of"), pairs, "distances that no simulated study improves in both"),
        "trade_off_others": (
            ("missed", "point", "of"),
            many,
            "distance, and number of other rows missed, that no simulated study improves in both",
        ),
        "bank_values": (("simulated", "unknown"), found.prior.values(bank.u), "configurations that were simulated"),
        "bank_rows": (("simulated", "row"), shown(rows), "rows of their studies"),
        "bank_distance": (
            ("simulated", "row"),
            checks.apart(rows, found.stand_in.error),
            "distance of each study from the printed numbers, in errors of the difference of two studies",
        ),
    }
    coords = {"missed": _words(missed), "point": np.arange(POINTS), "of": _words(("missed", "other"))}
    return xr.Dataset({k: xr.Variable(dims, x, {"long_name": text}) for k, (dims, x, text) in data.items()}, coords)


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
    replicates: np.ndarray,
    p: np.ndarray,
) -> xr.Dataset:
    prior, u, stand_in, honest = found.prior, found.posterior.u, found.stand_in, found.calibration
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
        "best": (("unknown",), prior.values(best.u), "configuration whose studies come nearest to the printed numbers"),
        "stand_in": (("unknown",), prior.values(stand_in.u), "hand-calibrated stand-in"),
        "printed": (("row",), np.array([row.value for row in ROWS]), "number printed in the paper; 0 for a ranking"),
        "predicted": (("particle", "row"), shown(replicates), "rows of papers drawn from the posterior predictive"),
        "p": (("row",), p, "posterior predictive p of the printed number"),
        "best_rows": (("study", "row"), shown(best.columns), "rows of studies at the best configuration"),
        "best_distance": (("row",), best.distance, "of the printed number, in joint standard errors"),
        "stand_in_rows": (("study", "row"), shown(stand_in.columns), "rows of studies at the stand-in"),
        "stand_in_distance": (("row",), stand_in.distance, "of the printed number, in joint standard errors"),
        "rank": (
            ("paper", "power", "unknown"),
            honest.rank,
            "share of the posterior below the true value, simulated papers",
        ),
        "covered": (
            ("level", "paper", "power", "unknown"),
            honest.covered,
            "whether the central interval of a level contains the true value",
        ),
        "chosen_by_others": (("paper",), np.array(POWERS)[honest.chosen_by_others], "power that all others choose"),
        "paper_width": (("paper", "power", "unknown"), honest.width, "posterior over prior standard deviation"),
        "paper_error": (
            ("paper", "power", "unknown"),
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
        "level": list(LEVELS),
        "power": list(POWERS),
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
