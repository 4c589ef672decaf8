"""Several recordings of one person under different stimuli, as one thing to fit or to diagnose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from mcstudy.errors import ModelError, RecordingError
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.recording import Recording, Suspicion
from mcstudy.short_repr import Summary, shortened
from mcstudy.stance.body import Body
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import joined

POOLED = ("stimulus", "rate_hz", "period_s", "convention")
"""Fields in which recordings must agree to be pooled; those that differ in one of them have a noise of their own."""


@dataclass(frozen=True, repr=False)
class JointRecording(Summary):
    """Recordings of one person that differ in kind of stimulus, period or sampling rate.

    Attributes
    ----------
    parts
        At least two `Recording`, those that agree in `POOLED` pooled. They have one body.

    Raises
    ------
    RecordingError
        The parts are of different bodies.
    """

    parts: tuple[Recording, ...]

    def __post_init__(self) -> None:
        first, *rest = self.parts
        if first.model is not None:
            raise RecordingError(
                f"{self.name}: expected one stimulus, period and sampling rate for outputs of a declared model "
                f"({first.model.name}), got several"
            )
        for r in rest:
            refuse_other_body(first, r)

    def facts(self) -> list[tuple[str, str]]:
        """What a prompt shows."""
        return [
            ("recordings", str(len(self.parts))),
            *((shortened(label), f"{p.duration_s:g} s") for label, p in zip(self.labels, self.parts, strict=True)),
            ("body", f"m g h = {self.body.mgh:.4g} N m/rad"),
        ]

    @property
    def name(self) -> str:
        """The names of all parts."""
        return " + ".join(dict.fromkeys(p.name for p in self.parts))

    @property
    def labels(self) -> tuple[str, ...]:
        """What tells the parts apart: the kind of stimulus, with the name where kinds repeat."""
        kinds = [p.stimulus for p in self.parts]
        named = [f"{p.stimulus} ({p.name})" if kinds.count(p.stimulus) > 1 else p.stimulus for p in self.parts]
        return tuple(n if named.count(n) == 1 else f"{n} {k}" for k, n in enumerate(named, start=1))

    @property
    def body(self) -> Body:
        """Inertia and gravity of the person."""
        return self.parts[0].body

    @property
    def suspicions(self) -> tuple[Suspicion, ...]:
        """Those of all parts; a published response has none."""
        return tuple(dict.fromkeys(s for p in self.parts for s in getattr(p, "suspicions", ())))

    def base_model(self, lines: Sequence[int]) -> Model:
        """The model on this body under all stimuli, with so many ``lines`` of each part; see `Recording.base_model`."""
        return joined([p.base_model() for p in self.parts], lines)


@dataclass(frozen=True, repr=False)
class ConditionsRecording(JointRecording):
    """Recordings or published responses of one person in several conditions, each a part of its own.

    Attributes
    ----------
    names
        Of the conditions, in the order of the parts.

    Raises
    ------
    RecordingError
        The parts are of different bodies, or some of them alone hold the outputs of a declared model.
    """

    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        first, *rest = self.parts
        for r in rest:
            if first.columns.outputs != r.columns.outputs:
                raise RecordingError(
                    f"{r.name}: expected {first.columns.names} as in {first.name}, got {r.columns.names}"
                )
            if first.model is None:
                refuse_other_body(first, r)

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of the conditions."""
        return self.names

    def base_model(self, lines: Sequence[int]) -> Model:
        """The model of all conditions, whose parameters are shared; its blocks have the names of the conditions.

        Nominal values and bounds are those of the first recording that has the parameter. Raises `RecordingError` where
        the models of two conditions have different loops.
        """
        models = [p.base_model() for p in self.parts]
        first = {p.name: p for m in reversed(models) for p in m.parameters}
        try:
            model = joined([replace(m, parameters=tuple(first[n] for n in m.names)) for m in models], lines)
        except ModelError as error:
            raise RecordingError(f"{self.name}: {error}") from None
        blocks = tuple(replace(b, name=name) for b, name in zip(model.blocks, self.names, strict=True))
        return replace(model, blocks=blocks)


AnyRecording = Recording | FrfRecording | JointRecording
"""What is fitted and diagnosed as one person."""


def refuse_other_body(first: Recording, other: Recording) -> None:
    """Raise `RecordingError`, naming the first constant, when ``other`` states another body."""
    if first.model != other.model:
        raise RecordingError(f"{other.name}: model: expected that of {first.name}, got another one")
    for f in fields(first.body):
        mine, given = getattr(first.body, f.name), getattr(other.body, f.name)
        if mine != given:
            raise RecordingError(
                f"{other.name}: body.{f.name}: expected {mine:.6g} as in {first.name}, got {given:.6g}; one person has "
                "one body"
            )


def part_labels(recording: AnyRecording | None, several: int) -> tuple[str, ...]:
    """What each of ``several`` parts is called."""
    if isinstance(recording, JointRecording):
        return recording.labels
    return tuple(f"recording {k + 1}" for k in range(several))
