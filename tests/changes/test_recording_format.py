"""A new file format of recordings is a module and a line in the list of formats."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

FORMAT = '''"""Arrays that NumPy has saved together."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.source import Source, Variable
from mcstudy.recordings.formats.text_layout import Dialect


def source(path: Path, dialect: Dialect) -> Source:
    """The arrays of an archive; raises `RecordingError`."""
    with path.open("rb") as file:
        if file.read(2) != b"PK":
            raise RecordingError(f"{path}: expected an archive of NumPy")
    arrays = np.load(path, allow_pickle=False)
    return Source(path, "NumPy", {n: Variable(n, arrays[n].shape, partial(arrays.get, n)) for n in arrays.files})
'''

USE = """
import numpy as np
import mcstudy as mc
from mcstudy.cli import main

simulated = mc.simulate({}, cycles=4, rate_hz=50.0, seed=1)
trial = simulated.trials[0]
leg, hip = trial.theta.T
np.savez("trial.npz", stimulus=trial.stimulus, leg=leg, hip=hip)
fields = {
    "channels": {"theta1": "leg", "theta2": "hip"}, "units": {"angle": "rad", "stimulus": "N m"}, "rate_hz": 50.0,
    "period_s": simulated.period_s, "body": {"height": 1.80, "weight": 75.0},
}
read = mc.import_recording("trial.npz", **fields)
assert read.trials[0].theta.tobytes() == trial.theta.tobytes()
main(["import", "trial.npz", "--list"])
open("false.npz", "w").write("no archive")
assert main(["import", "false.npz", "--list"]) == 2
try:
    main(["import", "--help"])
except SystemExit:
    pass
"""


def test_a_new_format_is_a_module_and_a_line_in_the_list_of_formats(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.add("mcstudy/recordings/formats/numpy_archive.py", FORMAT)
    last = '    Format("C3D", (".c3d",), "c3d"),\n'
    copy.edit(
        "mcstudy/recordings/formats/__init__.py", last, f'{last}    Format("NumPy", (".npz",), "numpy_archive"),\n'
    )
    printed = copy.run(USE)
    assert "trial.npz: NumPy, 3 variables" in printed
    assert "NumPy (.npz)" in " ".join(printed.split()), "the help of import names it"
    assert len(copy.touched) <= 3
