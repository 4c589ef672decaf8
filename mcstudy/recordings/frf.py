"""A published FRF as a recording: responses with their covariance and no time series."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.gain_and_phase import response
from mcstudy.recordings.recording import LEAST_LINES, escape_texts
from mcstudy.recordings.refusals import require_known, require_within
from mcstudy.short_repr import Summary, shortened
from mcstudy.stance.body import SINGLE, Body, one_segment, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.ranges import Range

F_HZ = Range(1e-4, 1e3, "Hz")
"""Frequencies of a published FRF."""

GAIN = Range(0.0, 1e3, "rad per unit of the stimulus")
"""Gains of a published FRF."""

SD = Range(1e-12, 1e3, "rad per unit of the stimulus")
"""Standard deviations of a published FRF."""

PARTS = ("re", "im", "gain", "phase", "sd")
"""Of the response of an angle."""

ROUNDING = 0.1
"""Share of a response by which its two forms, complex and polar, may differ."""

COLUMNS = ("f", *(f"{part}{k}" for k in (1, 2) for part in PARTS), "c12_re", "c12_im")
"""Columns of a table of responses; see `frf_of_columns`."""


@dataclass(frozen=True, repr=False)
class FrfRecording(Summary):
    """FRFs of one person or a group at N frequencies, with their covariance.

    Attributes
    ----------
    f
        (N,), Hz, increasing; at least 4.
    y
        (N, 2), complex FRFs of theta1 and theta2, rad per unit of the stimulus.
    C
        (N, 2, 2), complex covariance of ``y``: E[error error^H].
    stimulus
        Kind of stimulus, as in `Recording`.
    body
        Inertia and gravity of the person.
    single
        Whether only the first angle (a centre-of-mass or leg angle) was published. The one-segment model is then the
        base, and the second angle is zero in data and model.
    name, provenance
        Text for people.

    Raises
    ------
    RecordingError
        Shapes do not fit, a value is not finite or out of range, or a covariance is not positive definite.
    """

    f: np.ndarray
    y: np.ndarray
    C: np.ndarray
    stimulus: str = "ankle_torque"
    body: Body = field(default_factory=Body)
    single: bool = False
    name: str = "frf"
    provenance: str = ""

    def __post_init__(self) -> None:
        escape_texts(self, "name", "provenance")
        f, y, C, name = self.f, self.y, self.C, self.name
        n = f.size
        if f.shape != (n,) or y.shape != (n, 2) or C.shape != (n, 2, 2) or n < LEAST_LINES:
            raise RecordingError(f"{name}: expected at least {LEAST_LINES} points, f (N,), y (N, 2), C (N, 2, 2)")
        for label, values in (("f", f), ("y", y), ("C", C)):
            if not np.isfinite(values).all():
                raise RecordingError(f"{name}: {label}: a value is not finite")
        variance = np.einsum("nii->ni", C).real
        sd = np.sqrt(np.maximum(variance, 0.0))
        for label, allowed, of_lines in (("f", F_HZ, f), ("gain", GAIN, np.abs(y)), ("sd", SD, sd)):
            for value in (float(of_lines.min()), float(of_lines.max())):
                require_within(allowed, value, f"{name}: {label}")
        if (late := np.flatnonzero(np.diff(f) <= 0)).size:
            raise RecordingError(
                f"{name}: f: expected increasing frequencies, got {f[late[0] + 1]:g} Hz after {f[late[0]]:g} Hz"
            )
        if self.single:
            require_known(self.stimulus, SINGLE, f"{name}: stimulus", " where one angle was published")
        if (np.abs(C[:, 0, 1]) ** 2 >= (1 - 1e-9) * variance.prod(axis=1)).any():
            raise RecordingError(
                f"{name}: C: the covariance must be positive definite; expected |c12| below the product of the sd"
            )

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        f = self.f
        facts = [
            ("name", shortened(self.name)),
            ("stimulus", self.stimulus),
            ("points", f"{f.size}, {f[0]:.4g} to {f[-1]:.4g} Hz" if f.size else "0"),
            ("angles", "theta1" if self.single else "theta1, theta2"),
            ("body", f"m g h = {self.body.mgh:.4g} N m/rad"),
        ]
        return facts + ([("provenance", shortened(self.provenance))] if self.provenance else [])

    def base_model(self) -> Model:
        """The model without effects for these data."""
        return (one_segment if self.single else two_segment)(self.body, self.stimulus)


def frf_of_columns(
    columns: dict[str, np.ndarray], scale: float, name: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """f (N,), y (N, 2) and C (N, 2, 2) of a `FrfRecording` from named columns, and whether only one angle is there.

    Columns: ``f``, in any order; per angle k = 1, 2 either ``re<k>`` and ``im<k>`` or ``gain<k>`` and ``phase<k>``
    (deg), or both where they say the same; ``sd<k>``, the root of E|error|^2 of the mean; optionally ``c12_re`` and
    ``c12_im``, the cross-covariance. ``scale`` turns the FRFs' angle unit into rad. Raises `RecordingError` naming a
    missing column.
    """
    if "f" in columns:
        order = np.argsort(columns["f"], kind="stable")
        columns = {key: values[order] for key, values in columns.items()}

    def need(key: str, why: str = "") -> np.ndarray:
        if key not in columns:
            raise RecordingError(f"{name}: column {key!r} is missing{why}; found {', '.join(columns)}")
        if not np.isfinite(columns[key]).all():
            raise RecordingError(f"{name}: {key}: a value is not finite")
        return columns[key]

    def response_of(k: int) -> np.ndarray:
        polar = f"gain{k}", f"phase{k}"
        why = (
            ": a fit needs the first angle, of the legs or the centre of mass; the hip alone does not suffice"
            if k == 1
            else ": another column tells of the second angle; give its response, or leave the other out"
        )
        if not {f"re{k}", f"im{k}"} & set(columns):
            return response(need(polar[0], why), need(polar[1]), name, polar)
        y = need(f"re{k}") + 1j * need(f"im{k}")
        if set(polar) & set(columns):
            unlike = np.abs(response(need(polar[0]), need(polar[1]), name, polar) - y) > ROUNDING * np.abs(y)
            if unlike.any():
                raise RecordingError(
                    f"{name}: re{k}, im{k} and gain{k}, phase{k} contradict each other at f = "
                    f"{f[unlike][0]:g} Hz; leave the wrong ones out"
                )
        return y

    single = not any(c.startswith("c12_") or c in {f"{part}2" for part in PARTS} for c in columns)
    f = need("f")
    y, C = np.zeros((f.size, 2), dtype=complex), np.zeros((f.size, 2, 2), dtype=complex)
    C[:, 1, 1] = 1.0
    for k in (1,) if single else (1, 2):
        y[:, k - 1] = scale * response_of(k)
        meaning = "the standard error of the complex response, in the unit of the gain"
        sd = need(f"sd{k}", f": {meaning}")
        if not (sd > 0).all():
            raise RecordingError(f"{name}: sd{k}: expected positive numbers, got {sd[~(sd > 0)][0]:g}; it is {meaning}")
        C[:, k - 1, k - 1] = (scale * sd) ** 2
    if {"c12_re", "c12_im"} & set(columns):
        C[:, 0, 1] = scale**2 * (need("c12_re") + 1j * need("c12_im"))
        C[:, 1, 0] = C[:, 0, 1].conj()
    return f, y, C, single
