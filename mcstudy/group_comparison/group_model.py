"""The model of a group: its parameters as standard normal numbers, and what it says of the points.

The prior of every parameter makes it so. Gains are log-normal about those of `mcstudy.stance.body.two_segment`, scaled
with the gravity stiffness of the body (SD 0.6 of the logarithm); delays are log-normal about 0.1 s (SD 0.3); a sensory
weight is logit-normal about 0.5 (SD 1.5). Without a prior a dozen points do not determine the parameters of the model.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from mcstudy.recordings.frf_group import body_of_group
from mcstudy.spectra.frf_groups import as_real, model_points, model_points_jacobian
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate

GAIN_SD, DELAY_SD, WEIGHT_SD = 0.6, 0.3, 1.5
"""Of the prior: logarithm of gains and of delays, logit of a weight."""

MARGIN = 0.2
"""Least distance of the rightmost root of a fit from the imaginary axis, 1/s."""

STEP = 1e-5
"""Of differences, in standard normal numbers."""

DELAY_S = 0.1
"""Median of the prior of both delays."""


@dataclass(frozen=True)
class GroupModel:
    """The two-segment model for the stimulus, the body and the points of a group.

    Attributes
    ----------
    group: what `mcstudy.read_frf_group` returned.
    """

    group: xr.Dataset

    @cached_property
    def model(self) -> Model:
        """Its table."""
        return two_segment(body_of_group(self.group), self.group.attrs["stimulus"])

    @cached_property
    def is_weight(self) -> np.ndarray:
        """(P,) bool: which parameters are sensory weights."""
        return np.array([p.unit == "" for p in self.model.parameters])

    @cached_property
    def median(self) -> np.ndarray:
        """Of the prior, (P,)."""
        scale = body_of_group(self.group).mgh / Body().mgh
        units = [p.unit for p in self.model.parameters]
        values = zip(units, self.model.truth, strict=True)
        return np.array([DELAY_S if u == "s" else 0.5 if u == "" else scale * v for u, v in values])

    @cached_property
    def sd(self) -> np.ndarray:
        """Of the logarithm of a parameter, or of the logit of a weight, (P,)."""
        of_unit = {"s": DELAY_SD, "": WEIGHT_SD}
        return np.array([of_unit.get(p.unit, GAIN_SD) for p in self.model.parameters])

    def theta(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (..., P) and their derivatives in standard normal numbers ``z`` (..., P)."""
        positive = self.median * np.exp(np.clip(self.sd * z, -6.0, 6.0))
        share = 1 / (1 + np.exp(-self.sd * z))
        value = np.where(self.is_weight, share, positive)
        return value, self.sd * np.where(self.is_weight, share * (1 - share), positive)

    def response(self, z: np.ndarray) -> np.ndarray:
        """Points as real numbers, (..., D), of ``z`` (..., P)."""
        return as_real(model_points(self.model, self.theta(z)[0], self.group))

    def slope(self, z: np.ndarray) -> np.ndarray:
        """Their derivatives in ``z``, (..., D, P)."""
        value, steps = self.theta(z)
        J = as_real(model_points_jacobian(self.model, value, self.group)[1])
        return np.asarray(np.moveaxis(J, 0, -1) * steps[..., None, :])

    def instability(self, z: np.ndarray) -> np.ndarray:
        """How far the rightmost root lies right of ``-MARGIN``, in 1 / (10 s), (M,) of ``z`` (M, P); zero left of it.

        People stand, so a fit must be stable; unstable loops have FRFs that resemble measured ones.
        """
        return np.asarray(10 * np.maximum(growth_rate(self.model, self.theta(z)[0]) + MARGIN, 0.0))

    def instability_slope(self, z: np.ndarray) -> np.ndarray:
        """Its derivatives (M, P) by differences."""
        here, out = self.instability(z), np.zeros(z.shape)
        near = np.flatnonzero(here)
        if near.size:
            moved = self.theta(z[near, None] + STEP * np.eye(z.shape[1]))[0].reshape(-1, z.shape[1])
            growth = growth_rate(self.model, moved).reshape(near.size, -1)
            out[near] = (10 * (growth + MARGIN) - here[near, None]) / STEP
        return out

    def stable(self, z: np.ndarray) -> np.ndarray:
        """Whether the closed loop is, (M,) bool."""
        return np.asarray(growth_rate(self.model, self.theta(z)[0]) < 0)
