"""The equations and the diagram of a page say where a tilt enters the feedback."""

import re

import pytest

from mcstudy.report.study.diagram import diagram
from mcstudy.report.study.equations import equations
from mcstudy.stance.body import two_segment


@pytest.mark.parametrize(("kind", "weight", "passive"), [("surface_tilt", "prop", True), ("visual_tilt", "vis", False)])
def test_a_tilt_is_taken_from_the_angle_that_feedback_senses(kind: str, weight: str, passive: bool) -> None:
    model = two_segment(stimulus=kind)
    ankle, hip = re.sub(r"<[^>]+>", "", equations(model)).split("Hip: ")
    stiffness = "Kpas1(θ1−u)" if passive else "Kpas1θ1"
    assert ankle.endswith(f"=−{stiffness}−(K11+B11s)e−Td1s(θ1−W{weight}u)−(K21+B21s)e−Td1sθ2")
    assert hip.endswith(f"=−Kpas2θ2−(K12+B12s)e−Td2s(θ1−W{weight}u)−(K22+B22s)e−Td2sθ2")
    drawn = re.findall(r"acts on ([^<]*)<", diagram(model, "Model", "text"))
    assert drawn == ["θ1 − u"] * passive + [f"θ1 − W{weight} u"] * 2
