"""Running an inference: the bank, its waves, and the posterior of the unknowns.

    OUT/design.json   fingerprint of the inference file, and the program
    OUT/bank/         simulated studies, a few per file
    OUT/papers/       simulated papers whose tables were inferred, one per file
    OUT/result.zarr   posterior, posterior predictive, contradictions, calibration

The first studies are at points of the prior. Each wave simulates at points of the posterior found so far, under the
square root of the likelihood, so that the emulator becomes accurate where the posterior is without losing what lies
around it. The directed search (`mcstudy_goodworth2018.lost_table.search`) then simulates where most numbers are nearly
met at once. Everything is a function of the file's seed; a stopped run resumes with the same bits.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mcstudy import program
from mcstudy.errors import StudyChangedError
from mcstudy.files.json_files import ensure_folder, own_folder, read_document, write_text
from mcstudy.files.local_path import resolved
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.streams import stream
from mcstudy.study.cube.repair import refuse_part
from mcstudy_goodworth2018.lost_table.bank import Bank, prior_points, simulated
from mcstudy_goodworth2018.lost_table.calibration import POWERS, Calibration, calibrate
from mcstudy_goodworth2018.lost_table.checks import WAVE_OF_STAND_IN, Checked, repeated, stand_in_point
from mcstudy_goodworth2018.lost_table.design import InferenceFile
from mcstudy_goodworth2018.lost_table.emulator import Emulator
from mcstudy_goodworth2018.lost_table.posterior import THOROUGH, Likelihood, Posterior, sample, tempered
from mcstudy_goodworth2018.lost_table.rows import stated
from mcstudy_goodworth2018.lost_table.search import promising
from mcstudy_goodworth2018.lost_table.unknowns import Prior

WAVE_POWER = 0.5
"""Power of the likelihood whose posterior a wave is drawn from."""

FIRST_WAVE_OF_SEARCH = 201

NEAR = 500
"""Studies the final emulator is made of, at least: those whose predicted rows are nearest to the observed ones."""


@dataclass(frozen=True)
class Inferred:
    """What an inference found.

    Attributes
    ----------
    prior: the unknowns. prior_bank: studies at points of the prior. bank: those, the studies of the waves and those of
    the search. stand_in: repeated studies of the stand-in. emulator: the final one. calibration: of the inference.
    power: of the likelihood, by which the posterior is widened. posterior: given the paper's rows.
    """

    prior: Prior
    prior_bank: Bank
    bank: Bank
    stand_in: Checked
    emulator: Emulator
    calibration: Calibration
    power: float
    posterior: Posterior


def claim(file: InferenceFile, out: Path, finished: bool = False) -> None:
    """Make the folder of an inference, or check that it is that of ``file``; raises `StudyChangedError`.

    Nothing is kept together of two programs: a folder that another one has begun and not ``finished`` is refused.
    """
    refuse_part(resolved(out))
    own_folder(out, "design.json", "an inference")
    ensure_folder(out)
    design, own = out / "design.json", program.maker("mcstudy_goodworth2018")
    if not design.exists():
        write_text(design, json.dumps({"fingerprint": file.fingerprint, "program": own}))
        return
    found = read_document(design)
    if not isinstance(found, dict) or found.get("fingerprint") != file.fingerprint:
        raise StudyChangedError(f"{out}: made from another inference file; expected a new folder")
    if not finished and (why := program.other_maker(found.get("program"), own)):
        raise StudyChangedError(f"{out}: {why}; expected a new folder, or the program that has begun it")


def infer(file: InferenceFile, out: Path, options: ClusterOptions) -> Inferred:
    """Simulate what is missing of the bank and find the posterior; raises `Interrupted` when stopped."""
    claim(file, out)
    inference, prior = file.inference, Prior(file.prior)
    seed, n = inference.seed, inference.realizations
    points = prior_points(prior, stream(seed, "table_prior"), inference.prior_studies)
    bank = prior_bank = simulated(prior, points, (seed, 0, n), out / "bank", options)
    start = prior_points(prior, stream(seed, "table_particles"), inference.particles)
    observed = stated()
    for wave, studies in enumerate(inference.waves, start=1):
        likelihood = Likelihood.of(near(prior, bank, prior_bank, n, observed), observed)
        rng = stream(seed, "table_wave", wave)
        found = sample(likelihood, rng, inference.particles, WAVE_POWER, start)
        points = found.u[rng.permutation(len(found.u))[:studies]]
        if len(points) < studies:
            points = found.u[rng.integers(len(found.u), size=studies)]
        bank = bank.joined(simulated(prior, points, (seed, wave, n), out / "bank", options))
    stand_in = repeated(prior, stand_in_point(prior), (seed, WAVE_OF_STAND_IN, n), out, options)
    for turn, studies in enumerate(inference.search):
        rng = stream(seed, "table_search", turn)
        points = promising(prior, bank, Emulator.of(prior, bank, n), stand_in.error, rng, studies)
        bank = bank.joined(simulated(prior, points, (seed, FIRST_WAVE_OF_SEARCH + turn, n), out / "bank", options))
    settings = (seed, n, inference.particles // 2)
    calibration = calibrate(prior, prior_bank, inference.papers, settings, out / "papers", options)
    emulator, power = near(prior, bank, prior_bank, n, observed), POWERS[calibration.chosen]
    rng = stream(seed, "table_posterior")
    likelihood = Likelihood.of(emulator, observed)
    posterior = next(tempered(likelihood, rng, inference.particles, (power,), start, THOROUGH))
    return Inferred(prior, prior_bank, bank, stand_in, emulator, calibration, power, posterior)


def near(prior: Prior, bank: Bank, prior_bank: Bank, realizations: int, observed: np.ndarray) -> Emulator:
    """The emulator of the studies nearest to the observed rows, by rows that an emulator of all predicts.

    Studies are chosen by what is predicted for their configuration, not by their own rows: choosing by a result with
    Monte Carlo error would bias the emulator.
    """
    emulator = Emulator.of(prior, bank, realizations)
    if len(bank) <= max(NEAR, len(prior_bank)):
        return emulator
    order = np.argsort(-Likelihood.of(emulator, observed)(bank.u), kind="stable")
    return Emulator.of(prior, bank.take(np.sort(order[: max(NEAR, len(bank) // 2)])), realizations)
