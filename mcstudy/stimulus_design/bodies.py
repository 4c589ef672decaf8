"""Bodies drawn around that of a design file: every parameter and the mass vary, and only stable bodies stand.

Of a declared model, whose terms do not say what is proportional to a mass, the parameters vary alone.
"""

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
    """``n`` stable bodies as model sections of a study; raises `DesignError` when too few are stable."""
    base = build_model(file.group())
    body = {} if file.model.declared else asdict(Body(**file.model.body))
    return [
        with_values(
            file.model,
            {name: float(v * k) for name, v, k in zip(base.names, base.truth, factor, strict=False)},
            {name: float(v * (factor[-1] if name in MASS else 1.0)) for name, v in body.items()},
        )
        for factor in factors(file, base, n, rng)
    ]


def factors(file: DesignFile, base: Model, n: int, rng: np.random.Generator) -> np.ndarray:
    """Of ``n`` stable bodies, every parameter and the mass relative to those of ``base``, (n, P + 1).

    Raises `DesignError` when too few are stable.
    """
    spread, stable = file.prior.spread, np.empty((0, len(base.names) + 1))
    for _ in range(ATTEMPTS):
        if len(stable) >= n:
            break
        some = 1 + rng.uniform(-spread, spread, (max(n, 1), stable.shape[1]))
        if file.model.declared:
            some[:, -1] = 1.0
        stable = np.concatenate([stable, some[growth_rate(base, equivalent(base, some)) < 0]])
    if len(stable) < n:
        raise DesignError(f"prior.spread: no {n} stable bodies in {ATTEMPTS * n} draws, got {spread:g}")
    return stable[:n]


def equivalent(base: Model, factor: np.ndarray) -> np.ndarray:
    """Parameters (n, P) with which the body of ``base`` is as stable as bodies with ``factor`` (n, P + 1), and sways as
    they do up to one factor of each body.

    Inertia and gravity are proportional to the mass. So it divides all gains, delays and sensory weights stay as they
    are, and a torque is divided, too.
    """
    kept = np.array([name in base.delays or name in base.weights for name in base.names])
    return np.asarray(base.truth * factor[:, :-1] / np.where(kept, 1.0, factor[:, -1:]))


def with_values(section: ModelSection, truth: dict[str, float], body: dict[str, float]) -> ModelSection:
    """A model section with other true values; bounds stay relative to them."""
    fields: dict[str, Any] = section.model_dump(mode="json") | {"truth": truth} | ({"body": body} if body else {})
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
