"""A new compiled solver: one module, and its declaration."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

MODULE = '''"""The compiled cost at the starts themselves: the lowest is the answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.compiling.decorators import compiled
from mcstudy.fitting.kernel import evaluate_cost
from mcstudy.fitting.lanes import WIDTH
from mcstudy.fitting.plans import plan, workspace
from mcstudy.fitting.problem import Fits, Problem, queued, small_problem
from mcstudy.fitting.solvers import Options
from mcstudy.fitting.status import Status


@compiled
def costs(table, work, queue, out):  # type: ignore[no-untyped-def]
    """Costs of all starts."""
    P = queue.starts.shape[1]
    for m in range(queue.starts.shape[0]):
        for p in range(P):
            work.w[(work.trial + p) * WIDTH] = queue.starts[m, p]
        for k in range(queue.packed.shape[1]):
            work.w[(work.data + k) * WIDTH] = queue.packed[queue.problem[m], k]
        evaluate_cost(table, work)
        out[m] = work.w[(work.gram_trial + (P + 1) * (P + 2) // 2 - 1) * WIDTH]


def solve(problems: Sequence[Problem], which: np.ndarray, starts: np.ndarray, options: Options) -> Fits:
    """No step at all."""
    model, M = problems[0].model, len(starts)
    table, cost = plan(model, problems[0].f), np.empty(M)
    costs(table, workspace(table), queued(problems, which, starts), cost)
    return Fits.of(model, starts.copy(), cost, np.full(M, Status.STALLED), np.full(M, 1))


def compile_kernel() -> None:
    """Its compiled code."""
    problem = small_problem()
    solve([problem], np.zeros(1, dtype=np.int64), problem.model.truth[None], Options())
'''

DECLARED = """    Solver(
        name="look",
        solve="mcstudy.fitting.look:solve",
        parts={"look": Part("mcstudy.fitting.look:compile_kernel", 1, 3.0, after=("cost",))},
        starts_a_call=64,
    ),
    Solver(name="trf", solve="""

STUDY = """
import numpy as np
import mcstudy as mc
from mcstudy.fitting.solvers import fit
from mcstudy.study.design import FitSection
from mcstudy.study.kernels import parts_of

axes = dict(realizations=2, starts=3, fmax=[1.2], amplitude=[5.0])
study = mc.Study("s", seed=1).group("new", **axes, fit={"solver": "look"}).group("old", **axes)
cube = mc.run(study, "out.zarr", workers=1)
new, old = cube["new"], cube["old"]
print("look" in parts_of(study.groups.values()))
print(bool((new["estimate"] == old["initial"]).all()))
print(bool((new["cost"].min("start") > old["cost"].min("start")).all()))
print(sorted(set(new["status"].values.ravel().tolist())))
"""


def test_a_compiled_solver_runs_in_a_study(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.add("mcstudy/fitting/look.py", MODULE)
    copy.edit("mcstudy/fitting/solvers.py", '    Solver(name="trf", solve=', DECLARED)
    assert copy.run(STUDY).splitlines() == ["True", "True", "True", "[2]"]
    assert len(copy.touched) <= 3
