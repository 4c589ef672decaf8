"""A new question of the diagnosis is a file with its function and its answer, and one line in a list."""

from __future__ import annotations

import json
from pathlib import Path

from changes import Copy

QUESTION = '''"""How precisely was the response measured?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mcstudy.gap.questions.question import Answer, Inquiry
from mcstudy.text_tables import Table


@dataclass(frozen=True)
class Precision(Answer):
    """Median relative standard error (2,) of the responses of both angles."""

    name: ClassVar[str] = "precision"
    relative: tuple[float, float]

    def to_dict(self) -> dict[str, float]:
        return {"theta1": self.relative[0], "theta2": self.relative[1]}

    def sentence(self) -> str:
        return f"The response of theta1 is known to {100 * self.relative[0]:.0f} %."

    def table(self) -> Table:
        rows = [["theta1", f"{self.relative[0]:.3f}"], ["theta2", f"{self.relative[1]:.3f}"]]
        return Table("Precision of the responses", ["angle", "median relative SE"], rows)


def precision(inquiry: Inquiry) -> Precision:
    noise = np.sqrt(inquiry.lines.noise.variance) / np.abs(inquiry.lines.y)
    first, second = np.median(noise, axis=0)
    return Precision((float(first), float(second)))
'''

DIAGNOSIS = """
import json
import numpy as np
import mcstudy as mc
from mcstudy.files.json_files import json_text
from mcstudy.gap.tables import text

diagnosis = mc.diagnose(mc.simulate({}, cycles=4, rate_hz=50.0, seed=1), fast=True, fmax=2.0)
json_text(diagnosis.to_dict(), "diagnosis", "diagnosis")
expected = np.median(np.sqrt(diagnosis.lines.noise.variance) / np.abs(diagnosis.lines.y), axis=0)
print(json.dumps([expected.tolist(), diagnosis.to_dict()["answers"], diagnosis.verdict(), text(diagnosis)]))
"""


def test_a_new_question_has_its_computation_json_sentence_and_table_in_one_file(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.add("mcstudy/gap/questions/precision.py", QUESTION)
    diagnose = "mcstudy/gap/diagnose.py"
    above = "from mcstudy.gap.questions.question import Answer, Inquiry\n"
    copy.edit(diagnose, above, "from mcstudy.gap.questions.precision import precision\n" + above)
    copy.edit(diagnose, "= (detection_limits,)", "= (detection_limits, precision)")
    expected, answers, verdict, tables = json.loads(copy.run(DIAGNOSIS))
    assert answers == {"precision": {"theta1": expected[0], "theta2": expected[1]}}
    assert f"The response of theta1 is known to {100 * expected[0]:.0f} %." in verdict
    assert ["theta2", f"{expected[1]:.3f}"] in [row.split() for row in tables.splitlines()]
    assert len(copy.touched) <= 3
