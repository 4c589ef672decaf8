"""Shared problems of the fit tests."""

from __future__ import annotations

from functools import partial

import numpy as np

from mcstudy.effect_library import library
from mcstudy.fitting.problem import Problem, ml_cost, paper_cost
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.response import frf

F = np.array([1, 3, 5, 8, 10, 12, 14, 16, 18, 19, 21, 23, 24, 28, 35, 44, 56, 71, 88, 107, 133, 165, 201, 235]) / 43.72


def rich_model() -> Model:
    """The two-segment model with every kind of term: filters, products of gains, stimulus and output parameters."""
    model = two_segment().with_terms(
        parameters=(
            Parameter("Ki", "N m/(rad s)", 90.0, 0.0, 200.0),
            Parameter("Ka", "N m s2/rad", 5.0, -20.0, 20.0),
            Parameter("kappa", "1", 0.3, 0.0, 1.0),
            Parameter("tau", "s", 0.03, 0.0, 0.1),
            Parameter("omega", "rad/s", 12.0, 5.0, 40.0),
            Parameter("zeta", "1", 1.1, 0.2, 2.0),
            Parameter("lag", "s", 0.02, 0.0, 0.1),
            Parameter("epsilon", "1", 0.05, -0.3, 0.3),
        ),
        terms=(
            Term("ankle", "theta1", ("Ki",), -1, "Td1"),
            Term("ankle", "theta1", ("Ka",), 2, "Td1", ("muscle",)),
            Term("hip", "theta1", ("K22", "kappa"), 0, "Td2", coefficient=-1.0),
            Term("hip", "theta2s", ("epsilon",), 2, coefficient=7.08),
            Term("ankle", "stimulus", ("epsilon",), filters=("lowpass",)),
        ),
        filters=(
            Filter("lowpass", (Monomial(1.0, 0),), (Monomial(1.0, 0), Monomial(1.0, 1, (("tau", 1),)))),
            Filter(
                "muscle",
                (Monomial(1.0, 0, (("omega", 2),)),),
                (Monomial(1.0, 0, (("omega", 2),)), Monomial(2.0, 1, (("zeta", 1), ("omega", 1))), Monomial(1.0, 2)),
            ),
            Filter("sensor", (Monomial(1.0, 0),), (Monomial(1.0, 0), Monomial(1.0, 1, (("lag", 1),)))),
        ),
        name="rich",
    )
    return Model(model.name, model.parameters, model.terms, model.filters, output_filters=("sensor", "sensor"))


def measured(model: Model, rng: np.random.Generator, noise: float = 0.1, f: np.ndarray = F) -> np.ndarray:
    """FRFs of a model's truth with independent relative errors."""
    H = frf(model, model.truth, f)
    return H * (1 + noise * (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)))


def covariances(rng: np.random.Generator, data: np.ndarray) -> np.ndarray:
    """Hermitian positive definite 2 x 2 matrices on the scale of the data."""
    root = rng.standard_normal((len(data), 2, 2)) + 1j * rng.standard_normal((len(data), 2, 2))
    root = 0.1 * np.abs(data)[:, :, None] * (root + 2 * np.eye(2))
    return root @ np.conj(np.swapaxes(root, 1, 2))


def example(kind: str, seed: int = 0, noise: float = 0.1) -> Problem:
    """A noisy problem by name.

    ``paper``, ``ml``, ``rich`` (ml with every kind of term), ``one_segment``, ``tilt`` (ml) or ``late_tilt`` (ml, with
    a delay of the stimulus and the trunk's feedback in the space frame).
    """
    rng = np.random.default_rng(seed)
    tilted = partial(two_segment, stimulus="surface_tilt")
    late = partial(library.apply, tilted(), "stimulus_delay", "joint_stretch_frame")
    makers = {"rich": rich_model, "one_segment": one_segment, "tilt": tilted, "late_tilt": late}
    model = makers.get(kind, two_segment)()
    data = measured(model, rng, noise)
    if kind in ("paper", "one_segment"):
        return paper_cost(model, F, data)
    return ml_cost(model, F, data, covariances(rng, data))
