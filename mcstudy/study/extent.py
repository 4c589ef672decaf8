"""How large a study gets, from its design alone: chunks, files, tasks, and memory of the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.solvers import solvers
from mcstudy.study.cube.layout import Chunk, Layout, realizations_a_chunk
from mcstudy.study.design import Study
from mcstudy.study.experiment import Experiment

COPIES = 3
"""Copies of a chunk that a thread holds at most: its numbers, one array filled up to a whole chunk, encoded bytes."""


@dataclass(frozen=True)
class Extent:
    """Chunks, files (metadata and checksums among them), tasks and the numbers of the largest chunk, in bytes."""

    chunks: int
    files: int
    tasks: int
    largest_chunk: int

    def memory(self, threads: int) -> int:
        """Bytes that a run needs besides its libraries."""
        return (threads + 1) * COPIES * self.largest_chunk


def extent(study: Study, threads: int) -> Extent:
    """Extent of a new cube of a study whose run has that many threads."""
    layouts = [_layout(study, name) for name in study.groups]
    chunks = [len(layout.chunks) for layout in layouts]
    tasks = (-(-n // chunks_a_block(layout, n, threads)) for layout, n in zip(layouts, chunks, strict=True))
    return Extent(sum(chunks), 1 + sum(map(_files, layouts)), sum(tasks), max(map(_chunk_bytes, layouts)))


def chunks_a_block(layout: Layout, chunks: int, threads: int) -> int:
    """Chunks that make one task, of ``chunks`` pending ones: enough tasks for all threads to end at about one time."""
    fits = solvers()[layout.group.fit.solver].fits_a_block
    wanted = fits // max(1, layout.fits(Chunk(0, 0)))
    size = max(1, min(wanted, chunks // (8 * threads)))
    together = len(layout.group.amplitude)  # they share a realization's noise
    return size if not fits or size >= chunks else -(-size // together) * together


def _layout(study: Study, name: str) -> Layout:
    group = study.groups[name]
    return Experiment(group, study.study.seed).layout(realizations_a_chunk(group))


def _files(layout: Layout) -> int:
    """Files of a group: its metadata, those of its arrays, constants, and per chunk the results and a checksum file."""
    constants = sum(spec.values is not None for spec in layout.arrays.values())
    return 1 + len(layout.arrays) + constants + len(layout.chunks) * (len(layout.results) + 1)


def _chunk_bytes(layout: Layout) -> int:
    specs = (layout.arrays[name] for name in layout.results)
    return sum(int(np.prod(spec.chunks)) * np.dtype(spec.dtype).itemsize for spec in specs)
