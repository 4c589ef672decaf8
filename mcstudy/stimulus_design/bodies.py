"""Bodies drawn around that of a design file: every parameter and the mass vary, and only stable bodies stand."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from mcstudy.errors import DesignError
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate
from mcstudy.stimulus_design.design_file import DesignFile
from mcstudy.study.group import ModelSection
from mcstudy.study.models import build_model

ATTEMPTS = 200
"""Draws per body, of which one must be stable."""

MASS = ("J1", "J2", "C1", "C2", "A1", "A2")
"""Constants of a body that are proportional to its mass."""


def drawn(file: DesignFile, n: int, rng: np.random.Generator) -> list[ModelSection]:
    """``n`` stable bodies as model sections of a study; raises `DesignError` when none is found."""
    base, spread = build_model(file.group()), file.prior.spread
    body = asdict(Body(**file.model.body))
    out: list[ModelSection] = []
    for _ in range(ATTEMPTS * n):
        if len(out) == n:
            break
        factor = 1 + rng.uniform(-spread, spread, len(base.names) + 1)
        section = with_values(
            file.model,
            {name: float(v * k) for name, v, k in zip(base.names, base.truth, factor, strict=False)},
            {name: float(v * (factor[-1] if name in MASS else 1.0)) for name, v in body.items()},
        )
        model = model_of(file, section)
        if growth_rate(model, model.truth[None])[0] < 0:
            out.append(section)
    if len(out) < n:
        raise DesignError(f"prior.spread: no {n} stable bodies in {ATTEMPTS * n} draws, got {spread:g}")
    return out


def with_values(section: ModelSection, truth: dict[str, float], body: dict[str, float]) -> ModelSection:
    """A model section with other true values; bounds stay relative to them."""
    fields: dict[str, Any] = section.model_dump(mode="json") | {"truth": truth, "body": body}
    return ModelSection(**fields)


def model_of(file: DesignFile, section: ModelSection) -> Model:
    """The model of a body."""
    return build_model(file.group(model=section))


def relative(model: Model) -> np.ndarray:
    """Sizes of the true values (P,), in which errors are counted; raises `DesignError` for a value of zero."""
    size = np.abs(model.truth)
    if (size == 0).any():
        raise DesignError(
            f"model.truth.{model.names[int(np.argmin(size))]}: expected a value other than 0 (errors are relative)"
        )
    return size
