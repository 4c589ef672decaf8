"""The cube's layout follows from the design alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcstudy.fitting.solvers import solvers
from mcstudy.study.cube.layout import Layout, realizations_a_chunk
from mcstudy.study.design import Group
from mcstudy.study.experiment import Experiment
from mcstudy.study.study_file import parse_study, read_study

PIPELINES = Path(__file__).parents[2] / "pipelines"


def layout_of(group: Group) -> Layout:
    return Experiment(group, 1).layout(realizations_a_chunk(group))


@pytest.mark.usefixtures("small_chunks")
def test_every_fit_lies_in_exactly_one_chunk(tiny: str) -> None:
    group_layout = layout_of(parse_study(tiny).groups["noisy"])
    status = group_layout.arrays["status"]
    seen = np.zeros(status.shape, dtype=int)
    for chunk in group_layout.chunks:
        held = group_layout.realizations(chunk)
        seen[chunk.amplitude, :, held.start : held.stop] += 1
    assert len(group_layout.chunks) > 4
    assert (seen == 1).all()


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 200_000), st.integers(1, 5000), st.integers(1, 6))
def test_a_chunk_holds_a_sane_number_of_fits(realizations: int, starts: int, n_fmax: int) -> None:
    group = Group.model_construct(
        realizations=realizations, starts=starts, fmax=(1.0,) * n_fmax, amplitude=(3.0, 5.0), simulator="spectral"
    )
    depth = realizations_a_chunk(group)
    assert 1 <= depth <= realizations
    # At least one realization, else never more than about the largest chunk that is wanted.
    assert depth == 1 or depth * starts * n_fmax <= 1.5 * solvers()["lm"].fits_a_chunk[1]


def test_chunks_of_slow_solvers_are_small_enough_to_share_out_and_to_lose() -> None:
    groups = read_study(PIPELINES / "solvers.toml").groups
    for name, group in groups.items():
        fits = realizations_a_chunk(group) * group.starts * len(group.fmax)
        assert fits == (group.fits if name == "lm" else group.starts)


@pytest.mark.parametrize("name", ["status", "estimate", "cost", "frf"])
def test_an_empty_chunk_holds_the_fill_values_of_its_arrays(tiny: str, name: str) -> None:
    group_layout = layout_of(parse_study(tiny).groups["noisy"])
    chunk = group_layout.chunks[-1]
    values = group_layout.empty(chunk)[name]
    assert values.dtype == np.dtype(group_layout.arrays[name].dtype)
    assert (values == 0).all() if name == "status" else np.isnan(values).all()
