"""A new estimator of the noise is a class in a file of its own and one line in the list of estimators."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

ESTIMATOR = '''"""Noise of one cycle from the scatter of the cycles at each line alone."""

from __future__ import annotations

import numpy as np

from mcstudy.spectra.cycle_noise import Cycles
from mcstudy.spectra.null_draws import pooled


class ScatterNoise:
    """Sample covariance of the cycles."""

    def __init__(self, name: str, cycles: Cycles, at: np.ndarray) -> None:
        self._at, self._free = at, len(cycles.trial) - 1
        self.pooling = pooled(np.full(at.size, float(self._free)), 1)

    @staticmethod
    def suits(odd: bool) -> bool:
        return True

    def freed(self, cycles: Cycles) -> Cycles:
        return cycles

    def __call__(self, cycles: Cycles) -> tuple[np.ndarray, np.ndarray]:
        theta = cycles.theta[:, self._at]
        deviation = theta - theta.mean(axis=0)
        covariance = np.einsum("rni,rnj->nij", deviation, deviation.conj()) / self._free
        return covariance, np.full(self._at.size, float(self._free))
'''

LINES = """
import numpy as np
import mcstudy as mc
from mcstudy.spectra.periodic import periodic_lines

lines = periodic_lines(mc.simulate({}, cycles=6, rate_hz=50.0, seed=1), 2.0)
deviation = lines.repeats - lines.y
R = len(deviation)
expected = np.einsum("rni,rnj->nij", deviation, deviation.conj()) / (R - 1) / R
np.testing.assert_allclose(lines.noise.C, expected, rtol=1e-9)
print(*{float(n) for n in lines.noise.dof})
"""


def test_a_new_noise_estimator_is_a_class_and_a_line_in_a_list(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.add("mcstudy/spectra/scatter_noise.py", ESTIMATOR)
    periodic = "mcstudy/spectra/periodic.py"
    copy.edit(periodic, "(EvenLineNoise, DifferenceNoise)", "(ScatterNoise, EvenLineNoise, DifferenceNoise)")
    load = "from mcstudy.spectra.scatter_noise import ScatterNoise\n"
    above = "from mcstudy.spectra.periods import coefficients\n"
    copy.edit(periodic, above, above + load)
    assert copy.run(LINES).strip() == "9.0"
    assert len(copy.touched) <= 3
