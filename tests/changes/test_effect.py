"""A new effect of the library is one declaration: it is listed, simulated and a candidate of the diagnosis."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

DECLARATION = """DECLARATIONS: tuple[Effect, ...] = (
    Effect(
        name="cross_damping",
        equation="hip torque + Bhip s theta1",
        place=("hip",),
        sizes=(
            Size(
                name="Bhip",
                unit="N m s/rad",
                null=0.0,
                lower=-10.0,
                upper=40.0,
                published=(5.0, 15.0),
                meaning="damping of the hip by the ankle",
            ),
        ),
        build=terms(Term("hip", "theta1", ("Bhip",), 1)),
        source="assumption",
    ),
"""

LOOK = """
import mcstudy as mc
from mcstudy.cli import main

main(["gap", "effects"])
recording = mc.simulate(effects={"cross_damping": 12.0}, seed=1)
diagnosis = mc.diagnose(recording, fast=True)
print([cause for c in diagnosis.causes for cause in c.effects])
"""


def test_a_new_effect_is_one_declaration(tmp_path: Path) -> None:
    copy = Copy(tmp_path / "copy")
    copy.edit("mcstudy/effect_library/declarations.py", "DECLARATIONS: tuple[Effect, ...] = (\n", DECLARATION)
    shown = copy.run(LOOK)
    listed, _, causes = shown.rpartition("\n[")
    assert "damping of the hip by the ankle" in listed
    assert "'cross_damping'" in causes
    assert copy.touched == {"mcstudy/effect_library/declarations.py"}
