"""A planar chain of rigid segments, linearised about upright: the mechanical terms and outputs of a declared model.

Segment i = 1 .. n from the ground up has the angle phi_i in space; the joint angles q are their differences, phi = T q
with T the lower triangle of ones. With a_ji = L_i (i < j), h_i (i = j), 0 (i > j) the horizontal motion of
the centre of mass of segment j per angle of segment i,

    S = a^T diag(m) a + diag(I),   M = T^T S T,   c_i = sum_j m_j a_ji,   G = -g T^T diag(c) T
    (M s^2 + G) q = torques - s^2 T^T c x0,   x0 the horizontal position of the platform

Derived from the Lagrangian of the chain. A tilt of the surface has no term here: it is in what is sensed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.errors import ModelError
from mcstudy.stance.feedback import MOST_ROWS, Output, OutputTerm, Term


@dataclass(frozen=True)
class LinkedBody:
    """Linked segments, from the ground up.

    Attributes
    ----------
    mass
        Of each segment, kg, (n,).
    length
        From its lower to its upper joint, m, (n,); that of the last one is not used.
    height
        Of its centre of mass above its lower joint, m, (n,).
    inertia
        About its centre of mass, kg m^2, (n,).
    g
        Gravity, m/s^2.

    Raises
    ------
    ModelError
        The numbers are not of as many segments, one to four, or not those of bodies.
    """

    mass: tuple[float, ...]
    length: tuple[float, ...]
    height: tuple[float, ...]
    inertia: tuple[float, ...]
    g: float = 9.81

    def __post_init__(self) -> None:
        n = len(self.mass)
        for name in ("mass", "length", "height", "inertia"):
            values = tuple(float(x) for x in getattr(self, name))
            object.__setattr__(self, name, values)
            if not 1 <= n <= MOST_ROWS or len(values) != n:
                raise ModelError(f"linked body {name}: expected as many numbers as segments, 1 to {MOST_ROWS}")
            used = values[:-1] if name == "length" else values
            if not np.isfinite(values).all() or any(x < 0 or (x == 0 and name == "mass") for x in used):
                raise ModelError(f"linked body {name}: expected the numbers of bodies, got {values}")

    @property
    def _arms(self) -> np.ndarray:
        """a: motion of the centres of mass per angle of a segment in space, m, (centre, segment)."""
        return np.tril(np.tile(self.length, (len(self.mass), 1)), -1) + np.diag(self.height)

    @property
    def inertia_in_space(self) -> np.ndarray:
        """S by segment, kg m^2, (n, n)."""
        moved = (m * np.outer(a, a) for m, a in zip(self.mass, self._arms, strict=True))
        return np.asarray(sum(moved, np.diag(self.inertia)))

    @property
    def moments(self) -> np.ndarray:
        """c by segment, kg m, (n,): first moments of mass, gravity's stiffness divided by g."""
        return np.asarray(sum(m * a for m, a in zip(self.mass, self._arms, strict=True)))

    @property
    def inertia_matrix(self) -> np.ndarray:
        """M by joint, kg m^2, (n, n)."""
        in_space = np.tril(np.ones((len(self.mass),) * 2))
        return np.asarray(in_space.T @ self.inertia_in_space @ in_space)

    @property
    def platform(self) -> np.ndarray:
        """T^T c, kg m, (n,): torque by joint per acceleration of the platform, with the opposite sign."""
        return np.cumsum(self.moments[::-1])[::-1]

    @property
    def gravity_matrix(self) -> np.ndarray:
        """G by joint, N m/rad, (n, n): what is above the upper one of two joints."""
        at = np.arange(len(self.mass))
        return -self.g * self.platform[np.maximum.outer(at, at)]

    @property
    def centre_height(self) -> float:
        """Height of the centre of mass of all segments above the lowest joint, m."""
        return float(self.platform[0] / sum(self.mass))

    def terms(self, joints: tuple[str, ...]) -> tuple[Term, ...]:
        """Inertia and gravity of a model of these ``joints``, from the ground up, whose angles have their names."""
        self._check(joints)
        M, G = self.inertia_matrix, self.gravity_matrix
        pairs = [(j, k) for j in range(len(joints)) for k in range(len(joints))]
        return (
            *(Term(joints[j], joints[k], order=2, coefficient=float(M[j, k])) for j, k in pairs),
            *(Term(joints[j], joints[k], coefficient=float(G[j, k])) for j, k in pairs),
        )

    def platform_terms(self, joints: tuple[str, ...]) -> tuple[Term, ...]:
        """The stimulus of a platform that moves by u, m."""
        self._check(joints)
        return tuple(
            Term(joint, "stimulus", order=2, coefficient=-float(c))
            for joint, c in zip(joints, self.platform, strict=True)
        )

    def outputs(
        self,
        joints: tuple[str, ...],
        *,
        platform: bool = False,
        torque_at: str | None = None,
        ankle_height: float = 0.0,
    ) -> tuple[Output, ...]:
        """What may be recorded of a chain: choose among them for `mcstudy.stance.feedback.Model.outputs`.

        Parameters
        ----------
        joints
            Names of the joints and of their angles, from the ground up.
        platform
            Whether the stimulus is the position of the platform, m.
        torque_at
            The joint on which the stimulus acts as an external torque, if it does; it is no torque of that joint, and
            none on the force plate.
        ankle_height
            Of the lowest joint above the force plate, m.

        Returns
        -------
        tuple of Output
            ``com`` horizontal position of the centre of mass in space, m; ``com_angle`` its angle about the lowest
            joint, rad; ``cop`` centre of pressure, m from the lowest joint; ``torque_JOINT`` of each joint, N m
            (inverse dynamics: active and passive together).
        """
        self._check(joints)
        total, M, G = sum(self.mass), self.inertia_matrix, self.gravity_matrix
        centre = [OutputTerm(j, float(c / total)) for j, c in zip(joints, self.platform, strict=True)]
        moved = [OutputTerm("stimulus")] if platform else []

        def torque(k: int) -> list[OutputTerm]:
            inertia = [OutputTerm(j, float(x), 2) for j, x in zip(joints, M[k], strict=True)]
            gravity = [OutputTerm(j, float(x)) for j, x in zip(joints, G[k], strict=True)]
            outside = [OutputTerm("stimulus", float(self.platform[k]), 2)] if platform else []
            if joints[k] == torque_at:
                outside.append(OutputTerm("stimulus", -1.0))
            return [*inertia, *gravity, *outside]

        def scaled(terms: list[OutputTerm], factor: float, more: int = 0) -> list[OutputTerm]:
            return [OutputTerm(t.sense, factor * t.coefficient, t.order + more) for t in terms]

        weight = total * self.g
        shear = scaled([*centre, *moved], -ankle_height * total / weight, 2) if ankle_height else []
        return (
            Output("com", (*centre, *moved), "m"),
            Output("com_angle", tuple(scaled(centre, 1 / self.centre_height))),
            Output("cop", (*scaled(torque(0), -1 / weight), *shear), "m"),
            *(Output(f"torque_{joint}", tuple(torque(k)), "N m") for k, joint in enumerate(joints)),
        )

    def _check(self, joints: tuple[str, ...]) -> None:
        if len(joints) != len(self.mass):
            raise ModelError(f"linked body: expected {len(self.mass)} joints, got {joints}")
