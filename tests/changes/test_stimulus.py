"""A new kind of stimulus: one declaration, and studies, recordings, plans and pages know it."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

DECLARED = """    "trunk_torque": StimulusKind(
        unit="N m",
        description="a torque on the trunk, in N·m",
        terms=lambda body: (Term("ankle", "stimulus"), Term("hip", "stimulus")),  # noqa: ARG005
        considered=True,
    ),
    "surface_tilt": StimulusKind("""

STUDY = """
import numpy as np
import mcstudy as mc
from mcstudy.gap.trial_planning.choice import CONSIDERED
from mcstudy.report.study.model import KINDS
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

axes = dict(realizations=2, starts=2, fmax=[1.2], amplitude=[5.0])
study = mc.Study("s", seed=1).group("new", **axes, stimulus={"kind": "trunk_torque"})
cube = mc.run(study, "out.zarr", workers=1)["new"]
ankle, hip = (two_segment(stimulus=f"{joint}_torque") for joint in ("ankle", "hip"))
expected = sum(frf(model, model.truth, cube["frequency"].values) for model in (ankle, hip))
print(np.abs(cube["true_frf"].values / expected - 1).max() < 1e-12, cube["frf"].attrs["units"])
print(bool((cube["status"] == 1).all()), "trunk_torque" in CONSIDERED, KINDS["trunk_torque"].description)
recording = mc.simulate(stimulus="trunk_torque", amplitude=[5.0], cycles=3, rate_hz=50.0, seed=1)
mc.write_recording(recording, "trunk.nc")
print(recording.stimulus, mc.read_recording("trunk.nc").stimulus_unit)
try:
    mc.Study("s", seed=1).group("a", **axes, stimulus={"kind": "trunk"})
except mc.InputError as error:
    print("'trunk_torque'" in str(error))
"""


def test_a_stimulus_is_studied_recorded_planned_and_described(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.edit("mcstudy/stance/body.py", '    "surface_tilt": StimulusKind(', DECLARED)
    copy.edit("results_schema/1.0.0/recording.json", '"hip_torque"', '"hip_torque", "trunk_torque"')
    lines = copy.run(STUDY).splitlines()
    assert lines == ["True rad/(N m)", "True True a torque on the trunk, in N·m", "trunk_torque N m", "True"]
    assert len(copy.touched) <= 3
