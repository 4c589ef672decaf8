"""Linked segments: inertia, gravity, and feedback from every joint to every joint."""

from __future__ import annotations

import numpy as np

from mcstudy.stance.feedback import Model, Output, Parameter, Term

JOINTS = ("ankle", "knee", "hip", "neck")
LENGTH = np.array([0.246, 0.245, 0.288]) * 1.68
SEGMENTS = np.array([[0.093, 0.567, 0.302], [0.2, 0.567, 0.323], [0.678, 0.626, 0.496]])
"""Shank, thigh and the rest of a body of 73 kg and 1.68 m: share of its mass, then height of the centre of mass above
the lower joint and radius of gyration about it in segment lengths (Dempster via Winter; lengths Drillis & Contini)."""

GAINS = {
    "K": np.array([[1050, 855, 276], [550, 352, 170], [322, 276, 182.0]]),
    "B": np.array([[330, 224, 85.6], [219.3, 142.1, 72], [122.9, 77.2, 57.4]]),
    "Kpas": np.array([151, 342, 72.0]),
    "Td": np.array([0.080, 0.086, 0.092]),
}
"""A stable loop: rows are the joints that act, columns the angles sensed; N m/rad, N m s/rad, s."""


def body(n: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Inertia (n, n) and gravity (n, n) in joint coordinates, and feedback: the body above, or any of n joints."""
    if n == 3:
        m, h, radius = SEGMENTS.T * [[73.0], [1.0], [1.0]]
        arm, sums = np.tril(np.tile(LENGTH, (3, 1)), -1) + np.diag(h * LENGTH), np.tril(np.ones((3, 3)))
        M = sums.T @ (arm.T @ np.diag(m) @ arm + np.diag(m * (radius * LENGTH) ** 2)) @ sums
        return M, sums.T @ np.diag(-9.81 * (m @ arm)) @ sums, GAINS
    rng = np.random.default_rng(n)
    L = rng.normal(size=(n, n))
    gains = {"K": rng.normal(size=(n, n)), "B": rng.normal(size=(n, n)), "Kpas": rng.normal(size=n)}
    return L @ L.T + np.eye(n), rng.normal(size=(n, n)), {**gains, "Td": rng.uniform(0.05, 0.2, n)}


def model(n: int, outputs: tuple[Output, ...] = (), stimulus: str = "ankle") -> Model:
    """Linked segments with feedback from every angle to every joint, under a torque."""
    M, G, g = body(n)
    joints, parameters, terms = JOINTS[:n], [], []
    for j, joint in enumerate(joints):
        parameters += [("Kpas" + joint, g["Kpas"][j]), ("Td" + joint, g["Td"][j])]
        terms.append(Term(joint, joint, "Kpas" + joint))
        for k, sensed in enumerate(joints):
            terms += [Term(joint, sensed, order=2, coefficient=M[j, k]), Term(joint, sensed, coefficient=G[j, k])]
            for kind, order in (("K", 0), ("B", 1)):
                name = f"{kind}_{sensed}_{joint}"
                parameters.append((name, g[kind][j, k]))
                terms.append(Term(joint, sensed, name, order, "Td" + joint, noisy=True))
    terms.append(Term(stimulus, "stimulus"))
    bounded = tuple(Parameter(name, "", value, value - 1, value + 1) for name, value in parameters)
    return Model(f"joints_{n}", bounded, tuple(terms), angles=joints, outputs=outputs)


def matrices(n: int, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and its noisy part, (N, n, n), with joints from the lowest up."""
    M, G, g = body(n)
    s = (2j * np.pi * f)[:, None, None]
    active = (g["K"] + g["B"] * s) * np.exp(-g["Td"][:, None] * s)
    return M * s**2 + G + np.diag(g["Kpas"]) + active, active
