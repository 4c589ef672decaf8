"""A declared model of two joints that is no standing body: a motor drives a load through a flexible shaft."""

from __future__ import annotations

import numpy as np

import mcstudy as mc
from mcstudy.models.catalogue import checked_table
from mcstudy.stance.feedback import Model

INERTIA = {"motor": 0.02, "load": 0.05}

TABLE = {
    "name": "drive",
    "joints": ["motor", "load"],
    "constants": {"Jm": INERTIA["motor"], "Jl": INERTIA["load"]},
    "parameter": [
        {"name": "k", "unit": "N m/rad", "value": 40.0, "meaning": "stiffness of the shaft"},
        {"name": "c", "unit": "N m s/rad", "value": 0.2, "meaning": "viscosity of the shaft"},
        {"name": "bm", "unit": "N m s/rad", "value": 0.5, "meaning": "viscosity of the motor's bearing"},
        {"name": "bl", "unit": "N m s/rad", "value": 0.3, "meaning": "viscosity of the load's bearing"},
        {"name": "Kp", "unit": "N m/rad", "value": 15.0, "meaning": "position controller of the motor"},
        {"name": "Td", "unit": "s", "value": 0.02, "lower": 0.0, "upper": 0.05, "meaning": "its delay"},
    ],
    "term": [
        {"joint": "motor", "order": 2, "coefficient": "Jm"},
        {"joint": "motor", "order": 1, "gain": "bm"},
        {"joint": "motor", "sense": "motor - load", "gain": "k"},
        {"joint": "motor", "sense": "motor - load", "gain": "c", "order": 1},
        {"joint": "motor", "gain": "Kp", "delay": "Td", "noisy": True},
        {"joint": "load", "order": 2, "coefficient": "Jl"},
        {"joint": "load", "order": 1, "gain": "bl"},
        {"joint": "load", "sense": "load - motor", "gain": "k"},
        {"joint": "load", "sense": "load - motor", "gain": "c", "order": 1},
        {"joint": "motor", "sense": "stimulus"},
    ],
}
"""The model as a file holds it."""

ELBOW = {
    "name": "elbow",
    "joints": ["elbow"],
    "unit": "deg",
    "parameter": [
        {"name": "K", "unit": "N m/deg", "value": 0.18},
        {"name": "B", "unit": "N m s/deg", "value": 0.012},
    ],
    "term": [
        {"order": 2, "coefficient": 0.0014},
        {"gain": "K", "noisy": True},
        {"gain": "B", "order": 1},
        {"sense": "stimulus"},
    ],
}
"""A model of one joint, in deg."""


def drive() -> Model:
    """The drive."""
    return checked_table(TABLE).model()


def elbow() -> Model:
    """The elbow."""
    return checked_table(ELBOW).model()


def drive_frf(p: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Responses (N, 2) of the drive from its two equations of motion, written out."""
    k, c, bm, bl, Kp, Td = p
    s = 2j * np.pi * f
    shaft = k + c * s
    motor = INERTIA["motor"] * s**2 + bm * s + shaft + Kp * np.exp(-Td * s)
    load = INERTIA["load"] * s**2 + bl * s + shaft
    whole = motor * load - shaft**2
    return np.stack([load / whole, shaft / whole], axis=1)


def measured(seed: int, noise: float = 0.03, points: int = 60) -> mc.FrfRecording:
    """Responses of the drive with independent errors of ``noise`` times their gain."""
    f = np.linspace(0.2, 12.0, points)
    H = drive_frf(drive().truth, f)
    sd = noise * np.abs(H)
    rng = np.random.default_rng(seed)
    error = (rng.standard_normal(H.shape) + 1j * rng.standard_normal(H.shape)) * sd / np.sqrt(2)
    C = np.zeros((points, 2, 2), dtype=complex)
    C[:, [0, 1], [0, 1]] = sd**2
    return mc.FrfRecording(f, H + error, C, model=drive(), name="drive")
