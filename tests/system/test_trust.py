"""Workers on other machines: those that compute the same bits are used, the others refused before they write."""

from __future__ import annotations

from pathlib import Path

import pytest
from cubes import numbers
from dask_processes import cluster

from mcstudy.errors import Interrupted
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.environment import label
from mcstudy.study.execution import submission
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

STUDY = parse_study("""
[study]
name = "shared"
seed = 7

[group.noisy]
realizations = 8
starts = 4
fmax = [0.41, 1.2]
amplitude = [2.0, 3.0, 4.0, 5.0]
""")

# Loaded by workers, which then report another environment.
OTHER_CPU = """
import mcstudy.study.execution.attempt as attempt
from mcstudy.study.environment import environment as own  # this file may be loaded twice
attempt.environment = lambda: {**own(), "cpu": "another"}
"""

OTHER_VERSION = OTHER_CPU.replace('"cpu": "another"', '"versions": {**own()["versions"], "numpy": "0.1"}')

OTHER_SOURCE = OTHER_CPU.replace('"cpu"', '"source"')

# One unit in the last place of one estimate.
OTHER_BITS = (
    OTHER_CPU
    + """
import numpy as np
import mcstudy.study.execution.tasks as tasks, mcstudy.study.execution.trust as trust
from mcstudy.fitting.solvers import fit_queue as fit
def inexact(*args):
    fits = fit(*args)
    fits.estimate[0, 0] = np.nextafter(fits.estimate[0, 0], np.inf)
    return fits
tasks.fit_queue = trust.fit_queue = inexact
"""
)


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("local") / "local.zarr"
    run_study(STUDY, out, ClusterOptions(workers=1))
    return numbers(out)


def test_workers_of_other_environments_change_no_byte(
    local: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    others = {
        OTHER_VERSION: "workers of another environment agree in a sample of 32 fits of group noisy",
        OTHER_SOURCE: "refused, because they run other source code: source:",
        OTHER_BITS: "refused, because their fits have other bits: cpu:",
    }
    with cluster(tmp_path / "mixed") as made:
        for k, preload in enumerate(others):
            (tmp_path / f"other{k}.py").write_text(preload)
            made.add_worker("--preload", str(tmp_path / f"other{k}.py"))
        made.wait_for(len(others))
        made.add_worker()
        out = tmp_path / "mixed.zarr"
        outcome = run_study(STUDY, out, ClusterOptions(scheduler=made.address), block=1)
    assert (outcome.fits, outcome.failed_blocks) == (STUDY.fits, [])
    errors = capsys.readouterr().err
    for said in others.values():
        assert errors.count(said) == 1, errors
    assert numbers(out) == local
    cube = Cube.open(out)
    ((name, other),) = cube.attributes["environments"].items()
    assert (name, other["versions"]["numpy"]) == (label(other), "0.1")
    store = cube.groups["noisy"]
    named = [store.environments(chunk) for chunk in store.layout.chunks]
    assert {(name,), ()} >= set(named)
    assert (name,) in named
    findings = verify(out, cells=len(named))
    assert (findings.damage, findings.beyond) == ([], [])
    (note,) = (n for n in findings.notes if name in n)
    assert note.startswith(f"{named.count((name,))} chunks were computed, in part or whole, in environment {name}: ")


def test_a_run_stops_when_worker_after_worker_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(submission, "REFUSALS", 2)
    (tmp_path / "other.py").write_text(OTHER_SOURCE)
    with cluster(tmp_path / "refused") as made:
        for _ in range(2):
            made.add_worker("--preload", str(tmp_path / "other.py"))
        made.wait_for(2)
        with pytest.raises(Interrupted, match=r"2 workers were refused, because they run other source code \(source:"):
            run_study(STUDY, tmp_path / "refused.zarr", ClusterOptions(scheduler=made.address), block=1)
