"""The recording of Wang & van den Bogert, which is no part of the project: tests of it skip where it is not at hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording

ROOT = Path(__file__).parents[2]
WANG = ROOT.parent / "shared" / "real" / "wang"

needs_wang = pytest.mark.skipif(
    not WANG.is_dir(), reason="the recording of Wang & van den Bogert is not in ../shared/real/wang"
)


def wang() -> Recording:
    """The recording, as `pipelines/recordings/wang.toml` describes it."""
    recording = read_recording(ROOT / "pipelines" / "recordings" / "wang.toml", data=WANG)
    assert isinstance(recording, Recording)
    return recording
