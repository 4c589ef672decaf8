"""Cycles to discard follow from the decay of the slowest oscillation, and what outlasts them is told."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.lines import settling
from mcstudy.lines.settling import cycles_to_discard, unsettled
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.stance.body import two_segment
from mcstudy.stance.stability import Proof, Rightmost

MODEL = two_segment()


def recording(cycles: int, period_s: float | None = 40.0) -> Recording:
    n = cycles * 400
    t = np.arange(n) / 10.0
    theta = 0.01 * np.column_stack([np.sin(t), np.cos(t)])
    return Recording((Trial(np.sin(2 * np.pi * t / 40.0), theta, 1.0),), 10.0, period_s)


def with_root(monkeypatch: pytest.MonkeyPatch, root: complex) -> None:
    proof = np.array(Proof.SEARCH, dtype=np.int8)
    monkeypatch.setattr(settling, "rightmost_root", lambda *_: Rightmost(np.array(root), proof))


@pytest.mark.parametrize(
    ("root", "cycles", "discarded"),
    [
        (-1 + 9j, 6, 1),
        (-0.05 + 9j, 6, 2),
        (-0.03 + 9j, 6, 3),
        (-0.01 + 9j, 6, 3),
        (0.01 + 9j, 8, 4),
        (-0.001 + 0j, 6, 1),
    ],
)
def test_cycles_are_discarded_until_the_oscillation_is_over_or_half_are_gone(
    monkeypatch: pytest.MonkeyPatch, root: complex, cycles: int, discarded: int
) -> None:
    with_root(monkeypatch, root)
    assert cycles_to_discard(recording(cycles), MODEL, MODEL.truth) == discarded


def test_what_outlasts_the_discarded_cycles_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with_root(monkeypatch, -0.01 + 2j * np.pi)
    (note,) = unsettled(recording(6), MODEL, MODEL.truth, 3)
    assert "1.00 Hz" in note
    assert "keeps 30 % of its first amplitude after the 3 discarded cycles" in note  # exp(-0.01 * 120)
    with_root(monkeypatch, 0.01 + 2j * np.pi)
    assert "does not decay" in unsettled(recording(6), MODEL, MODEL.truth, 3)[0]


def test_the_nominal_body_and_a_recording_without_cycles_need_no_more_than_one() -> None:
    assert cycles_to_discard(recording(6), MODEL, MODEL.truth) == 1
    assert unsettled(recording(6), MODEL, MODEL.truth, 1) == ()
    assert cycles_to_discard(recording(6, None), MODEL, MODEL.truth) == 1
