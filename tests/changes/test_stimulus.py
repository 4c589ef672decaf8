"""A new kind of stimulus: one declaration, and studies, recordings, plans and pages know it."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

DECLARED = """    "waist_pull": StimulusKind(
        unit="N",
        description="a forward pull at the waist, in N",
        terms=lambda body: (Term("ankle", "stimulus", coefficient=0.9),),  # noqa: ARG005
        considered=True,
    ),
    "surface_tilt": StimulusKind("""

STUDY = """
import numpy as np
import mcstudy as mc
from mcstudy.gap.planned.choice import CONSIDERED
from mcstudy.report.sections.model import KINDS
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

axes = dict(realizations=2, starts=2, fmax=[1.2], amplitude=[5.0])
cube = mc.run(mc.Study("s", seed=1).group("new", **axes, stimulus={"kind": "waist_pull"}), "out.zarr", workers=1)["new"]
torque = two_segment()
expected = 0.9 * frf(torque, torque.truth, cube["frequency"].values)
print(np.abs(cube["true_frf"].values / expected - 1).max() < 1e-12, cube["frf"].attrs["units"])
print(bool((cube["status"] == 1).all()), "waist_pull" in CONSIDERED, KINDS["waist_pull"].description)
recording = mc.simulate(stimulus="waist_pull", amplitude=[20.0], cycles=3, rate_hz=50.0, seed=1)
mc.write_recording(recording, "waist.nc")
print(recording.stimulus, mc.read_recording("waist.nc").stimulus_unit)
try:
    mc.Study("s", seed=1).group("a", **axes, stimulus={"kind": "waist"})
except mc.InputError as error:
    print("'waist_pull'" in str(error))
"""


def test_a_stimulus_is_studied_recorded_planned_and_described(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.edit("mcstudy/stance/body.py", '    "surface_tilt": StimulusKind(', DECLARED)
    copy.edit(
        "mcstudy/recordings/recording.py", '    "N m": Range(', '    "N": Range(1e-3, 1e3, "N"),\n    "N m": Range('
    )
    copy.edit("mcstudy/recordings/checks.py", "LARGEST_STIMULUS = {", 'LARGEST_STIMULUS = {"N": 500.0, ')
    copy.edit("mcstudy/recordings/checks.py", "SMALLEST_STIMULUS = {", 'SMALLEST_STIMULUS = {"N": 1e-6, ')
    lines = copy.run(STUDY).splitlines()
    assert lines == ["True rad/(N)", "True True a forward pull at the waist, in N", "waist_pull N", "True"]
    assert len(copy.touched) <= 3
