"""Goodness of fit of each recording of a joint set, in the fit of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.spectra.lines import Lines
from mcstudy.text_tables import p_words


@dataclass(frozen=True)
class PartFit:
    """Goodness of fit of one recording.

    Attributes
    ----------
    lines
        Its number of lines.
    chi2, expected_chi2, p_value
        Squared residual of its lines, its mean without a gap, and its p-value.
    """

    lines: int
    chi2: float
    expected_chi2: float
    p_value: float


def part_fits(lines: Lines, residual: np.ndarray, null: np.ndarray) -> tuple[PartFit, ...]:
    """Of every recording in ``lines``, from whitened residuals (2 N Y,) and null samples of them (2 N Y, D)."""
    out = []
    for part, block in zip(lines.parts, lines.blocks, strict=True):
        chi2 = float((residual.reshape(2, len(lines), -1)[:, block] ** 2).sum())
        nulls = (null.reshape(2, len(lines), -1, null.shape[-1])[:, block] ** 2).sum(axis=(0, 1, 2))
        p_value = (1 + int((nulls >= chi2).sum())) / (1 + nulls.size)
        out.append(PartFit(len(part), chi2, float(nulls.mean()), p_value))
    return tuple(out)


def told(labels: Sequence[str], parts: Sequence[PartFit]) -> str:
    """One sentence: squared residual, its mean for noise alone and p-value of every recording."""
    each = (
        f"{name} {p.chi2:.0f} of {p.expected_chi2:.0f} ({p_words(p.p_value)})"
        for name, p in zip(labels, parts, strict=True)
    )
    return f"Squared residual of each recording, and its mean for noise alone: {'; '.join(each)}."


def parts_dict(labels: Sequence[str], parts: Sequence[PartFit]) -> dict[str, Any]:
    """The field ``recordings`` of a JSON file about a joint set; nothing for a single recording."""
    if len(parts) < 2:
        return {}
    return {
        "recordings": [
            {"name": name, "lines": p.lines, "chi2": p.chi2, "expected": p.expected_chi2, "p_value": p.p_value}
            for name, p in zip(labels, parts, strict=True)
        ]
    }
