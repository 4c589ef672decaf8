"""A published FRF as a recording: responses with their covariance and no time series."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Self

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.columns import Columns
from mcstudy.recordings.gain_and_phase import response
from mcstudy.recordings.recording import LEAST_LINES, escape_texts, told_subject
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

ANY = Range(1e-30, 1e30, or_zero=True)
"""Frequencies, gains and standard deviations of a declared model, whose units may be any."""

PARTS = ("re", "im", "gain", "phase", "sd")
"""Of the response of an angle."""

MISSING = {
    "1": ": a fit needs the first angle, of the legs or the centre of mass; the hip alone does not suffice",
    "2": ": another column tells of the second angle; give its response, or leave the other out",
}
"""What is said where the response of an angle of a standing body is missing."""

ROUNDING = 0.1
"""Share of a response by which its two forms, complex and polar, may differ."""


def labels_of(model: Model | None) -> tuple[str, ...]:
    """What tells the columns of outputs apart: ``1`` and ``2`` of a standing body, names of outputs behind a ``_``."""
    return ("1", "2") if model is None else tuple(f"_{name}" for name in model.output_names)


def columns_of(labels: Sequence[str]) -> tuple[str, ...]:
    """Columns of a table of responses; see `frf_of_columns`."""
    across = (f"c{a}{b}_{part}" for a, b in combinations(labels, 2) for part in ("re", "im"))
    return ("f", *(f"{part}{k}" for k in labels for part in PARTS), *across)


@dataclass(frozen=True, repr=False)
class FrfRecording(Summary):
    """FRFs of one person or a group at N frequencies, with their covariance.

    Attributes
    ----------
    f
        (N,), Hz, increasing; at least 4.
    y
        (N, Y), complex FRFs of what was measured: of a standing body its two angles, or the first one, rad per unit of
        the stimulus; of a declared model its outputs, in their units.
    C
        (N, Y, Y), complex covariance of ``y``: E[error error^H].
    stimulus
        Kind of stimulus, as in `Recording`.
    body
        Inertia and gravity of the person.
    single
        Whether only the first angle (a centre-of-mass or leg angle) of a standing body was published. The one-segment
        model is then the base.
    name, provenance
        Text for people.
    model
        The declared model whose outputs were measured; None for a standing body.
    constants
        Numbers of the person that it took, as in `Recording`.

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
    model: Model | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        escape_texts(self, "name", "provenance")
        if self.model is not None:
            object.__setattr__(self, "stimulus", "stimulus")
        Y = len(self.columns.outputs)
        f, y, C, name = self.f, self.y, self.C, self.name
        n = f.size
        if f.shape != (n,) or y.shape != (n, Y) or C.shape != (n, Y, Y) or n < LEAST_LINES:
            raise RecordingError(f"{name}: expected at least {LEAST_LINES} points, f (N,), y (N, {Y}), C (N, {Y}, {Y})")
        for label, values in (("f", f), ("y", y), ("C", C)):
            if not np.isfinite(values).all():
                raise RecordingError(f"{name}: {label}: a value is not finite")
        variance = np.einsum("nii->ni", C).real
        sd = np.sqrt(np.maximum(variance, 0.0))
        ranges = (F_HZ, GAIN, SD) if self.model is None else (ANY, ANY, ANY)
        for label, allowed, of_lines in zip(("f", "gain", "sd"), ranges, (f, np.abs(y), sd), strict=True):
            for value in (float(of_lines.min()), float(of_lines.max())):
                require_within(allowed, value, f"{name}: {label}")
        if (late := np.flatnonzero(np.diff(f) <= 0)).size:
            raise RecordingError(
                f"{name}: f: expected increasing frequencies, got {f[late[0] + 1]:g} Hz after {f[late[0]]:g} Hz"
            )
        if self.single:
            require_known(self.stimulus, SINGLE, f"{name}: stimulus", " where one angle was published")
        pairs = combinations(range(Y), 2)
        if any((np.abs(C[:, i, j]) ** 2 >= (1 - 1e-9) * variance[:, i] * variance[:, j]).any() for i, j in pairs):
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
            ("measured", self.columns.names),
            told_subject(self),
        ]
        return facts + ([("provenance", shortened(self.provenance))] if self.provenance else [])

    @property
    def columns(self) -> Columns:
        """Names and units of what was measured, and the unit of the stimulus."""
        columns = Columns.of(self.model, self.stimulus)
        return replace(columns, outputs=columns.outputs[:1], units=columns.units[:1]) if self.single else columns

    def with_columns(self, model: Model, at: Sequence[int], factor: np.ndarray, drive: float) -> Self:
        """The same as responses of a declared model: its outputs (Y,) are the columns ``at`` times a ``factor``.

        ``drive``: factor of the stimulus.
        """
        per = factor / drive
        C = self.C[:, list(at)][:, :, list(at)] * np.outer(per, per)
        return replace(self, y=self.y[:, list(at)] * per, C=C, single=False, model=model)

    def base_model(self) -> Model:
        """The model without effects for these data."""
        if self.model is not None:
            return self.model
        return (one_segment if self.single else two_segment)(self.body, self.stimulus)


def frf_of_columns(
    columns: dict[str, np.ndarray], scale: np.ndarray | float, name: str, labels: Sequence[str] = ("1", "2")
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """f (N,), y (N, Y) and C (N, Y, Y) of a `FrfRecording` from named columns, and whether only the first of two is.

    Columns: ``f``, in any order; per output, of which k is the label, either ``re<k>`` and ``im<k>`` or ``gain<k>`` and
    ``phase<k>`` (deg), or both where they say the same; ``sd<k>``, the root of E|error|^2 of the mean; optionally
    ``c<k><m>_re`` and ``c<k><m>_im``, the cross-covariance of k and m. ``scale`` (Y,) turns the units of the FRFs into
    ours. Raises `RecordingError` naming a missing column.
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

    def response_of(k: str) -> np.ndarray:
        polar = f"gain{k}", f"phase{k}"
        if not {f"re{k}", f"im{k}"} & set(columns):
            return response(need(polar[0], MISSING.get(k, "")), need(polar[1]), name, polar)
        y = need(f"re{k}") + 1j * need(f"im{k}")
        if set(polar) & set(columns):
            unlike = np.abs(response(need(polar[0]), need(polar[1]), name, polar) - y) > ROUNDING * np.abs(y)
            if unlike.any():
                raise RecordingError(
                    f"{name}: re{k}, im{k} and gain{k}, phase{k} contradict each other at f = "
                    f"{f[unlike][0]:g} Hz; leave the wrong ones out"
                )
        return y

    single = tuple(labels) == ("1", "2") and not set(columns_of(labels)) - set(columns_of("1")) & set(columns)
    labels = labels[:1] if single else labels
    f, Y = need("f"), len(labels)
    per = np.resize(np.asarray(scale, dtype=float), len(labels))
    y, C = np.zeros((f.size, Y), dtype=complex), np.zeros((f.size, Y, Y), dtype=complex)
    for i, k in enumerate(labels):
        y[:, i] = per[i] * response_of(k)
        meaning = "the standard error of the complex response, in the unit of the gain"
        sd = need(f"sd{k}", f": {meaning}")
        if not (sd > 0).all():
            raise RecordingError(f"{name}: sd{k}: expected positive numbers, got {sd[~(sd > 0)][0]:g}; it is {meaning}")
        C[:, i, i] = (per[i] * sd) ** 2
    _fill_covariances(C, labels, per, columns, need)
    return f, y, C, single


def _fill_covariances(
    C: np.ndarray,
    labels: Sequence[str],
    per: np.ndarray,
    columns: Mapping[str, np.ndarray],
    need: Callable[[str], np.ndarray],
) -> None:
    """Fill C (N, Y, Y) with the covariances between outputs that the columns state."""
    for (i, a), (j, b) in combinations(enumerate(labels), 2):
        re, im = f"c{a}{b}_re", f"c{a}{b}_im"
        if {re, im} & set(columns):
            C[:, i, j] = per[i] * per[j] * (need(re) + 1j * need(im))
            C[:, j, i] = C[:, i, j].conj()
