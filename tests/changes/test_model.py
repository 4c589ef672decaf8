"""A new model is one file; another package brings one by an entry point, without a change here."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

KNEE = """
[model]
name = "knee"
description = "shank about the knee of a seated person"
joints = ["knee"]
constants = { J = 0.35, m = 4.2, h = 0.25 }
term = [
  { order = 2, coefficient = "J" },
  { coefficient = "m*9.81*h" },
  { gain = "B", order = 1 },
  { gain = "K", delay = "Td", noisy = true },
  { sense = "stimulus" },
]
parameter = [
  { name = "K", unit = "N m/rad", value = 20.0 },
  { name = "B", unit = "N m s/rad", value = 2.0 },
  { name = "Td", unit = "s", value = 0.05 },
]
"""

CHECKED = """
import sys
import numpy as np
from mcstudy.cli import main
from mcstudy.models.catalogue import read_model
from mcstudy.stance.response import frf

model = read_model("knee").model()
print(repr(complex(frf(model, model.truth, [0.5])[0, 0])))
main(["models"])
sys.exit(main(["models", "knee", "--check"]))
"""


def knee(hz: float) -> complex:
    s = 2j * 3.141592653589793 * hz
    return complex(1 / (0.35 * s**2 + 4.2 * 9.81 * 0.25 + 2 * s + 20 * 2.718281828459045 ** (-0.05 * s)))


def test_a_new_model_is_one_file(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    copy.add("pipelines/models/knee.toml", KNEE)
    value, *printed = copy.run(CHECKED).splitlines()
    assert abs(complex(value) - knee(0.5)) < 1e-12 * abs(knee(0.5))
    assert any(line.split(maxsplit=1) == ["knee", "shank about the knee of a seated person"] for line in printed)
    assert "knee: 1 joint, 3 parameters, 5 terms" in printed
    assert "every parameter moves the response" in printed
    assert len(copy.touched) == 1


def test_another_package_brings_a_model_by_its_name(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    (tmp_path / "knee_lab.toml").write_text(KNEE, encoding="utf-8")
    (tmp_path / "knee_lab.py").write_text("MODEL = __file__.replace('.py', '.toml')\n", encoding="utf-8")
    metadata = tmp_path / "knee_lab-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: knee-lab\nVersion: 1.0\n", encoding="utf-8")
    (metadata / "entry_points.txt").write_text("[mcstudy.models]\nknee = knee_lab:MODEL\n", encoding="utf-8")
    assert "knee: 1 joint, 3 parameters, 5 terms" in copy.run(CHECKED).splitlines()
    assert copy.touched == set()
