"""Inertia and gravity of the standing body, and the two reference models built on them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace

from mcstudy.errors import ModelError
from mcstudy.stance import anthropometry
from mcstudy.stance.feedback import ANGLES, ROWS, Derived, Model, Parameter, Term
from mcstudy.stance.linked_body import LinkedBody
from mcstudy.stance.provenance import BODY, stand_in
from mcstudy.stance.ranges import Range, within

DELAY_MARGIN = 0.030
"""Half-width of the delay bounds in s (Goodworth & Peterka 2018, Methods)."""

DEFINITE = 1e-6
"""Least determinant of a body's inertia, relative to the product of its diagonal (the paper's body: 0.49)."""

_INERTIA = within(1e-4, 1e4, "kg m^2")
_MOMENT = within(1e-3, 1e4, "kg m")

SEGMENTS: dict[str, Range] = {
    "m1": Range(1e-2, 1e3, "kg"),
    "h1": Range(1e-2, 10.0, "m"),
    "I1": Range(1e-5, 1e4, "kg m^2"),
    "m2": Range(1e-2, 1e3, "kg"),
    "h2": Range(1e-2, 10.0, "m"),
    "I2": Range(1e-5, 1e4, "kg m^2"),
    "L1": Range(1e-2, 10.0, "m"),
}
"""Parameters of `Body.from_segments` but g, and their ranges."""


@dataclass(frozen=True, slots=True)
class Body:
    """Linearised two-segment body (Goodworth & Peterka 2018, Appendix, after Koozekanani et al. 1980).

    The defaults are the paper's. The ankle row is the whole-body balance, so in joint coordinates the mass matrix is
    [[J1 + C2, C2], [C1 + J2, J2]] by rows (ankle, hip).

    Attributes
    ----------
    J1, J2, C1, C2
        Inertia of the two balances (see the model's equations), kg m^2.
    A1, A2
        First moments of mass: gravity's stiffness divided by g, kg m.
    g
        Gravity, m/s^2.

    Raises
    ------
    ModelError
        A constant is outside its range, or the inertia is that of no body: the matrix of the kinetic energy,
        [[J1 - C1, M12], [M12, J2]] in the angles of the segments in space with M12 the mean of C1 and C2 - J2 (which
        are equal in a body), must be positive definite.
    """

    J1: float = field(default=51.26, metadata=_INERTIA)
    J2: float = field(default=7.08, metadata=_INERTIA)
    C1: float = field(default=11.93, metadata=_INERTIA)
    C2: float = field(default=19.01, metadata=_INERTIA)
    A1: float = field(default=50.42, metadata=_MOMENT)
    A2: float = field(default=14.45, metadata=_MOMENT)
    g: float = field(default=9.81, metadata=within(0.1, 100.0, "m/s^2"))

    def __post_init__(self) -> None:
        for f in fields(self):
            if fault := f.metadata["within"].fault(getattr(self, f.name)):
                raise ModelError(f"body.{f.name}: {fault}")
        legs, coupling = self.J1 - self.C1, (self.C1 + self.C2 - self.J2) / 2
        if not (legs > 0 and legs * self.J2 - coupling**2 > DEFINITE * legs * self.J2):
            raise ModelError(
                "body: expected J1, J2, C1, C2 of a body (positive definite inertia), got J1 - C1 = "
                f"{legs:.6g}, J2 = {self.J2:.6g}, coupling {coupling:.6g} kg m^2"
            )

    @classmethod
    def from_segments(
        cls,
        m1: float,
        h1: float,
        I1: float,
        m2: float,
        h2: float,
        I2: float,
        L1: float,
        g: float = 9.81,
    ) -> Body:
        """Body from its segments: 1 the legs, 2 head, arms and trunk; a `LinkedBody` of two.

        Parameters
        ----------
        m1, m2
            Masses, kg.
        h1, h2
            Heights of the centres of mass above the ankle and above the hip, m.
        I1, I2
            Moments of inertia about the centres of mass, kg m^2.
        L1
            Length from ankle to hip, m.
        g
            Gravity, m/s^2.

        Raises
        ------
        ModelError
            A value is outside its range.
        """
        given = {"m1": m1, "h1": h1, "I1": I1, "m2": m2, "h2": h2, "I2": I2, "L1": L1}
        for name, value in given.items():
            if fault := SEGMENTS[name].fault(value):
                raise ModelError(f"body.{name}: {fault}")
        linked = LinkedBody((m1, m2), (L1, 0.0), (h1, h2), (I1, I2), g)
        ((m11, m12), (_, m22)), (a1, a2) = linked.inertia_in_space.tolist(), linked.moments.tolist()
        return cls(J1=m11 + m12, J2=m22, C1=m12, C2=m12 + m22, A1=a1, A2=a2, g=g)

    @classmethod
    def from_person(
        cls, height: float, weight: float, sex: str | None = None, table: str | None = None, g: float = 9.81
    ) -> Body:
        """Body of a person by a published table of segments (`mcstudy.stance.anthropometry`).

        Parameters
        ----------
        height, weight
            Of the whole body: m, kg.
        sex
            ``"female"`` or ``"male"``; None for a table that holds for both.
        table
            ``"winter"`` (Winter 2009, Table 4.1) or ``"deleva"`` (de Leva 1996, Table 4; needs ``sex``). When None,
            ``deleva`` where the sex is stated, else ``winter``.
        g
            Gravity, m/s^2.

        Raises
        ------
        ModelError
            A value is outside its range, or there is no such table.
        """
        return cls.from_segments(**anthropometry.segments(height, weight, sex, table), g=g)

    @property
    def mgh(self) -> float:
        """Gravity stiffness of the whole body about the ankle, N m/rad."""
        return (self.A1 + self.A2) * self.g

    def terms(self) -> tuple[Term, ...]:
        """Inertia and gravity as rows of the model table."""
        g = self.g
        return (
            Term("hip", "theta2s", order=2, coefficient=self.J2),
            Term("hip", "theta2s", coefficient=-self.A2 * g),
            Term("hip", "theta1", order=2, coefficient=self.C1),
            Term("ankle", "theta1", order=2, coefficient=self.J1),
            Term("ankle", "theta1", coefficient=-self.A1 * g),
            Term("ankle", "theta2s", order=2, coefficient=self.C2),
            Term("ankle", "theta2s", coefficient=-self.A2 * g),
        )


@dataclass(frozen=True, kw_only=True)
class StimulusKind:
    """A kind of stimulus: all that other rooms know of it.

    Attributes
    ----------
    unit
        Of the stimulus; N m for a torque, else it is a motion.
    description
        What u is, in a sentence of a page.
    terms
        b(s) of what acts on the body; none for a tilt, which acts on the senses (`tilt_terms`).
    weight
        The sensory weight that a tilt makes visible; the other senses have the rest of 1.
    one_segment
        Whether it moves the single pendulum, whose hip is locked.
    considered
        Whether `mcstudy gap next` considers it unless others are named.
    """

    unit: str
    description: str
    terms: Callable[[Body], tuple[Term, ...]] = lambda body: ()  # noqa: ARG005
    weight: Parameter | None = None
    one_segment: bool = False
    considered: bool = False


KINDS: dict[str, StimulusKind] = {
    "ankle_torque": StimulusKind(
        unit="N m",
        description="a torque about the ankle, in N·m",
        terms=lambda body: (Term("ankle", "stimulus"),),  # noqa: ARG005
        one_segment=True,
        considered=True,
    ),
    "hip_torque": StimulusKind(
        unit="N m",
        description="a torque about the hip, in N·m",
        terms=lambda body: (Term("hip", "stimulus"),),  # noqa: ARG005
        considered=True,
    ),
    "platform_translation": StimulusKind(
        unit="m",
        description="the translation of the platform, in m",
        terms=lambda body: (
            Term("hip", "stimulus", order=2, coefficient=-body.A2),
            Term("ankle", "stimulus", order=2, coefficient=-(body.A1 + body.A2)),
        ),
        considered=True,
    ),
    "surface_tilt": StimulusKind(
        unit="rad",
        description="the tilt of the support surface, in rad",
        weight=Parameter("Wprop", "", 0.7, 0.0, 1.0, "weight of proprioception (lower body to surface)"),
        one_segment=True,
    ),
    "visual_tilt": StimulusKind(
        unit="rad",
        description="the tilt of the visual scene, in rad",
        weight=Parameter("Wvis", "", 0.2, 0.0, 1.0, "weight of vision (lower body to visual scene)"),
        one_segment=True,
    ),
}
"""Kinds of stimulus by the name that study files and recordings give them."""

STIMULI = {name: kind.unit for name, kind in KINDS.items()}
"""Kinds of stimulus and their units."""

TORQUES = tuple(kind for kind, unit in STIMULI.items() if unit == "N m")
"""Kinds that are torques; the others are motions."""

WEIGHTS = {name: kind.weight for name, kind in KINDS.items() if kind.weight is not None}
"""The sensory weight that a tilt makes visible, by kind of stimulus."""

SINGLE = tuple(name for name, kind in KINDS.items() if kind.one_segment)
"""Kinds of stimulus of the single pendulum."""

PASSIVE = {"two_segment": "Kpas1", "one_segment": "Kpas"}
"""The passive stiffness of the ankle, by model; the paper states it."""

STIFFNESSES = {"two_segment": (("K11", "Kpas1"), ("K22", "Kpas2")), "one_segment": (("K", "Kpas"),)}
"""Active and passive stiffness of each joint, whose sum is a quantity of its own (Goodworth & Peterka 2018, Fig. 6)."""


def stimulus_terms(kind: str, body: Body, feedback: Iterable[Term] = ()) -> tuple[Term, ...]:
    """b(s) of a stimulus kind.

    Ankle torque (0, 1), hip torque (1, 0) and platform translation -s^2 (A2, A1 + A2) act on the body. A tilt acts on
    what ``feedback``, the terms of the loop, senses: see `tilt_terms`.
    """
    return tilt_terms(kind, feedback) if kind in WEIGHTS else KINDS[kind].terms(body)


def tilt_terms(kind: str, feedback: Iterable[Term], *, at_joint: bool = False) -> tuple[Term, ...]:
    """The stimulus terms of a tilt: what the feedback of theta1 senses of the surface or of the visual scene.

    Active feedback acts on the weighted sum of the senses (Peterka 2002),

        Wvest theta1 + Wprop (theta1 - surface) + Wvis (theta1 - scene),     Wvest + Wprop + Wvis = 1,

    so that a tilt u is sensed as theta1 - W u. The ankle joint turns with the surface, so passive torque acts on
    theta1 - surface with weight 1. The hip angle does not hold the tilt (Goodworth & Peterka 2018, Fig. 1). The axis of
    rotation is that of the ankle joints, and the feet have no mass, so a tilt has no inertial torque.

    Parameters
    ----------
    kind: key of `WEIGHTS`. feedback: terms of the loop; those that do not sense theta1 through a gain give nothing.
    at_joint: whether active terms sense the ankle joint alone, as a stretch reflex does.
    """
    out = []
    for term in feedback:
        if term.sense != "theta1" or not term.gain:
            continue
        if term.noisy and not at_joint:
            out.append(replace(term, sense="stimulus", gain=(*term.gain, WEIGHTS[kind].name)))
        elif kind == "surface_tilt":
            out.append(replace(term, sense="stimulus"))
    return tuple(out)


def tilt_of(model: Model) -> str | None:
    """The kind of tilt that a model senses, None for a model with another stimulus."""
    return next((kind for kind, weight in WEIGHTS.items() if weight.name in model.weights), None)


def standing(model: Model) -> bool:
    """Whether a model is of the standing body: its balances and angles have the names of that body's."""
    return set(model.rows) <= set(ROWS) and set(model.angles) <= set(ANGLES)


def _gain(name: str, unit: str, value: float, meaning: str) -> Parameter:
    return Parameter(name, unit, value, 0.0, 2.0 * value, meaning)


def _delay(name: str, value: float, meaning: str) -> Parameter:
    return Parameter(name, "s", value, value - DELAY_MARGIN, value + DELAY_MARGIN, meaning)


def with_scaled_gains(model: Model, ratio: float) -> Model:
    """The model with all gains and their bounds times ``ratio``; delays and sensory weights stay."""
    kept = {*model.delays, *model.weights}
    parameters = tuple(
        p if p.name in kept else replace(p, value=p.value * ratio, lower=p.lower * ratio, upper=p.upper * ratio)
        for p in model.parameters
    )
    return replace(model, parameters=parameters)


def two_segment(body: Body | None = None, stimulus: str = "ankle_torque") -> Model:
    """The 12-parameter model of Goodworth & Peterka 2018 (Fig. 1B, Appendix) with the stand-in truth.

    Parameters
    ----------
    body
        Inertia and gravity; the paper's by default.
    stimulus
        ``"ankle_torque"`` (N m), ``"hip_torque"`` (N m), ``"platform_translation"`` (m), or ``"surface_tilt"`` and
        ``"visual_tilt"`` (rad), which add a sensory weight to the parameters (`WEIGHTS`).
    """
    body = body or Body()
    K, B = "N m/rad", "N m s/rad"
    parameters = (
        _gain("K11", K, 1057.0, "active stiffness, lower body to ankle torque"),
        _gain("K12", K, 270.0, "active stiffness, lower body to hip torque"),
        _gain("K21", K, 380.0, "active stiffness, hip angle to ankle torque"),
        _gain("K22", K, 201.0, "active stiffness, hip angle to hip torque"),
        _gain("B11", B, 372.0, "active damping, lower body to ankle torque"),
        _gain("B12", B, 64.0, "active damping, lower body to hip torque"),
        _gain("B21", B, 41.0, "active damping, hip angle to ankle torque"),
        _gain("B22", B, 29.5, "active damping, hip angle to hip torque"),
        _gain("Kpas1", K, 146.0, "passive stiffness of the ankle"),
        _gain("Kpas2", K, 69.0, "passive stiffness of the hip"),
        _delay("Td1", 0.080, "time delay of active ankle torque"),
        _delay("Td2", 0.092, "time delay of active hip torque"),
    )

    def active(row: str, sense: str, k: str, b: str, delay: str) -> tuple[Term, Term]:
        return (
            Term(row, sense, (k,), 0, delay, noisy=True),
            Term(row, sense, (b,), 1, delay, noisy=True),
        )

    feedback = (
        *active("hip", "theta1", "K12", "B12", "Td2"),
        *active("hip", "theta2", "K22", "B22", "Td2"),
        Term("hip", "theta2", ("Kpas2",)),
        *active("ankle", "theta1", "K11", "B11", "Td1"),
        *active("ankle", "theta2", "K21", "B21", "Td1"),
        Term("ankle", "theta1", ("Kpas1",)),
    )
    return _model("two_segment", parameters, body, body.terms(), feedback, stimulus)


def one_segment(body: Body | None = None, stimulus: str = "ankle_torque") -> Model:
    """Single inverted pendulum with delayed PD control and passive stiffness (the form of Peterka 2002).

    Parameters
    ----------
    body
        Its hip is locked; the paper's by default. Gains are those of the ankle loop of `two_segment`.
    stimulus
        One of `SINGLE`: ``"ankle_torque"`` (N m), ``"surface_tilt"`` or ``"visual_tilt"`` (rad).

    Raises
    ------
    ModelError
        The stimulus moves the hip or the platform.
    """
    body = body or Body()
    if stimulus not in SINGLE:
        raise ModelError(f"stimulus: expected one of {', '.join(SINGLE)} for one_segment, got {stimulus!r}")
    parameters = (
        _gain("K", "N m/rad", 1057.0, "active stiffness"),
        _gain("B", "N m s/rad", 372.0, "active damping"),
        _gain("Kpas", "N m/rad", 146.0, "passive stiffness"),
        _delay("Td", 0.080, "time delay of active torque"),
    )
    whole = (
        Term("ankle", "theta1", order=2, coefficient=body.J1 + body.C2),
        Term("ankle", "theta1", coefficient=-body.mgh),
    )
    feedback = (
        Term("ankle", "theta1", ("K",), 0, "Td", noisy=True),
        Term("ankle", "theta1", ("B",), 1, "Td", noisy=True),
        Term("ankle", "theta1", ("Kpas",)),
    )
    return _model("one_segment", parameters, body, whole, feedback, stimulus)


def _model(
    name: str,
    parameters: tuple[Parameter, ...],
    body: Body,
    inertia: tuple[Term, ...],
    feedback: tuple[Term, ...],
    stimulus: str,
) -> Model:
    """Inertia and gravity, feedback and stimulus as one table; a tilt adds its weight to the parameters."""
    tilted = stimulus in WEIGHTS
    replaced, weights = [BODY] if body != Body() else [], [WEIGHTS[stimulus].name] if tilted else []
    joints = 1 + any(t.row == ROWS[0] for t in inertia)
    return Model(
        name,
        (*parameters, WEIGHTS[stimulus]) if tilted else parameters,
        (*inertia, *feedback, *stimulus_terms(stimulus, body, feedback)),
        rows=ROWS[-joints:],
        angles=ANGLES[:joints],
        stimulus_unit=STIMULI[stimulus],
        provenance=stand_in(PASSIVE[name], replaced, weights),
        derived=tuple(Derived(f"{active} + {passive}", "N m/rad") for active, passive in STIFFNESSES[name]),
    )
