"""A diagnosis, and the next trial."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from pipelines.schemas.kinds import NonNegative, Number, Probability, closed


@closed
class Place(TypedDict):
    """Probability of each location; the remainder to 1 is not assigned."""

    ankle: Probability
    hip: Probability
    stimulus: Probability
    sensor: Probability
    body: Probability
    recording: NotRequired[Probability]
    """A mislabelled recording."""


@closed
class Size(TypedDict):
    """`size` of `cause`."""

    estimate: float
    se: float | None
    low: float | None
    high: float | None
    unit: str


@closed
class Interval(TypedDict):
    """Median and 95 % limits."""

    estimate: float
    low: float
    high: float


@closed
class Cause(TypedDict):
    """`cause` of `diagnosis`."""

    effects: Annotated[list[str], Field(min_length=1, max_length=2)]
    """Effects that act together, each the most probable of its ambiguity group. With advice: the code of the way in
    which the recording is mislabelled."""
    advice: NotRequired[str]
    """Only for a mislabelled recording: what is wrong and what to check."""
    alternatives: list[list[str]]
    """Per effect: all effects of its ambiguity group, itself included."""
    probability: Probability
    """Probability of the group."""
    size: dict[str, Size]
    """Per parameter of the effects: posterior mean, standard deviation, 95 % limits."""
    likeness: NotRequired[Interval | None]
    """Share of the gap that this cause predicts at lines that were left out of its fit, 0 to 1; null without a gap in
    the mean response and for a cause that leaves the mean response unchanged. Absent in files of version 1.0.0."""


@closed
class Prior(TypedDict):
    """`prior` of `diagnosis`."""

    none: Probability
    single: Probability
    pair: Probability
    unknown: Probability
    beside: Probability


@closed
class OtherHypothesis(TypedDict):
    """`credible_set` of `diagnosis`."""

    cause: Literal["none", "unknown"]


@closed
class NamedHypothesis(TypedDict):
    """`credible_set_other` of `diagnosis`."""

    cause: Literal["named"]
    effects: list[str]


@closed
class Closure(TypedDict):
    """`closed_other` of `diagnosis`."""

    fraction: Probability
    low: Probability
    high: Probability
    at_noise_floor: bool
    energy_before: float
    energy_after: float
    trials_needed: Number


@closed
class SwayError(TypedDict):
    """Error of predicted sway, deg, over all angles: base model, with the leading cause, and where only noise is left;
    null where outputs are no angles in rad."""

    before: float | None
    after: float | None
    floor: float | None


@closed
class Undetectable(TypedDict):
    """`undetectable` of `diagnosis`."""

    effect: str
    reason: str
    size_needed: float | None
    unit: str
    trials_needed: int | None


@closed
class GoodnessOfFit(TypedDict):
    """`fit` of `diagnosis`."""

    chi2: float
    expected: float
    p_value: Probability
    lines: int
    noise: NotRequired[Annotated[list[float], Field(min_length=2, max_length=2)]]
    """Range of chi2 in 95 % of recordings with noise alone; absent in older files."""
    added_chi2: NotRequired[float | None]
    """chi2 of the model with the leading cause; null when none was added, absent in older files."""


@closed
class Evidence(TypedDict):
    """Test for deviations of known shape: ln Bayes factor of any of them against none; absent in older files."""

    log_factor: float
    limit: float
    """95 % of recordings with noise alone are below."""
    p_value: Probability


@closed
class Band(TypedDict):
    """`band` of `diagnosis`."""

    angle: str
    low_hz: float
    high_hz: float
    level: float
    limit: float
    beyond: bool


@closed
class ResidualMap(TypedDict):
    """Standardised residuals per line, leverage removed; limit: 95 % of the largest under noise."""

    f: list[float]
    theta1: NotRequired[list[float]]
    theta2: NotRequired[list[float]]
    outputs: NotRequired[dict[str, list[float]]]
    """In place of both angles: what a declared model measures, by name."""
    limit: float


@closed
class Change(TypedDict):
    """`change` of `contrast`."""

    effect: str
    gain: float
    se: float
    z: float


@closed
class Contrast(TypedDict):
    """`contrast` of `diagnosis`."""

    kind: Literal["amplitude", "time"]
    between: list[float]
    p_value: Probability
    changes: list[Change]


@closed
class Parameter(TypedDict):
    """`parameter` of `diagnosis`."""

    name: str
    unit: str
    without: float
    without_se: float | None
    added: float | None
    added_se: float | None
    without_from: NotRequired[Literal["data", "prior", "bound"]]
    """Origin of the value: the data; mostly the prior (without the priors the variance would be at least twice as
    large); a bound on which the fit ends. Absent in older files."""
    added_from: NotRequired[Literal["data", "prior", "bound", None]]
    """The same with the leading cause. Absent in older files."""


@closed
class Recording(TypedDict):
    """`recording` of `diagnosis`."""

    name: str
    lines: Number
    chi2: float
    expected: float
    """Mean of chi2 for noise alone."""
    p_value: Probability


@closed
class Remaining(TypedDict):
    """The corrective torque G(s) x that the data leave unexplained once the mechanism is in the model."""

    row: str
    """Joint at which it acts: ankle or hip."""
    sense: str
    """What it depends on, x: theta1, theta2 or stimulus."""
    probability: Probability
    """Probability that a torque remains at all."""
    path_probability: Probability
    """Probability of this joint and x among all, if one remains."""
    poles: Annotated[int, Field(ge=0, le=3)]
    """Number of poles with the largest weight."""
    poles_weight: Annotated[list[Probability], Field(min_length=4, max_length=4)]
    """Akaike weights of 0, 1, 2 and 3 poles."""
    unit: str
    """Unit of G."""
    numerator: list[float]
    """Of the best fit with so many poles: coefficients of ascending powers of s, 1/s."""
    denominator: list[float]
    """The same; the first is 1."""
    rms: Interval | None
    """Root mean square of the torque in these recordings, N m; null without time series."""
    share: Interval | None
    """Root mean square of the torque over that of the active torque of the joint; null without active torque."""
    clearest_hz: float
    """Line that the torque changes most, in standard errors."""
    chi2: float
    """Squared residual of all lines with this torque too."""
    f: list[float]
    """Lines, Hz."""
    gain: list[float]
    """Magnitude of G at these lines, median."""
    gain_low: list[float]
    """2.5 %."""
    gain_high: list[float]
    """97.5 %."""
    phase: list[float]
    """Phase of G, deg, median."""
    phase_low: list[float]
    """2.5 %."""
    phase_high: list[float]
    """97.5 %."""


@closed
class Nearest(TypedDict):
    """`nearest_other` of `diagnosis`."""

    effects: Annotated[list[str], Field(min_length=1, max_length=2)]
    alternatives: list[list[str]]
    """Per effect: all effects of its ambiguity group."""
    probability: Probability
    likeness: Interval | None
    """As in causes."""
    chi2: float
    """Squared residual of all lines with the mechanism."""
    bands: list[Band]
    """As bands, with the mechanism in the model."""
    remaining: Remaining


@closed
class Diagnosis(TypedDict):
    """What `mcstudy gap diagnose --json` prints. Mismatch between a model and a recording: where it is, which
    unmodelled effect explains it, and which share of it that effect closes. Angles are in deg only where a name says
    so; null: the number does not exist."""

    schema: Literal["mcstudy:diagnosis:1.1.0", "mcstudy:diagnosis:1.0.0"]
    """Files of version 1.0.0 conform too: likeness, nearest and answers are all that was added."""
    name: str
    verdict: str
    """One paragraph in plain words."""
    detected: bool
    """Whether there is a gap beyond noise at the 5 % level."""
    p_value: Probability
    """p-value of that test, including amplitude dependence and drift."""
    place: Place | dict[str, Probability]
    """Of a declared model: of its rows, "stimulus" and "sensor"."""
    place_abstained: Probability
    causes: list[Cause]
    """Causes in order of decreasing probability; negligible ones are left out."""
    none_probability: Probability
    unknown_probability: Probability
    prior: NotRequired[Prior]
    """Prior probabilities: no missing effect, one effect of the library, two effects, a cause outside the library, such
    a cause beside an effect; absent in older files, where they are 0.30, 0.52, 0.03, 0.11 and 0.04."""
    none_log_bayes_factor: NotRequired[float]
    """ln Bayes factor of no missing effect against all others: with another prior p, the posterior odds of no missing
    effect are p / (1 - p) times its exponential. Absent in older files."""
    credible_set: list[OtherHypothesis | NamedHypothesis]
    """Smallest set of hypotheses with a probability of 95 %."""
    closed: Closure | None
    """Share of the gap that the leading named cause closes, with 95 % limits; null without a gap."""
    sway_rms_deg: SwayError
    sway_noise_deg: NotRequired[Annotated[list[NonNegative], Field(min_length=2, max_length=2)] | None]
    """Range of that error in 95 % of recordings with noise alone, deg; null without time series, absent in
    older files."""
    undetectable: list[Undetectable]
    fit: GoodnessOfFit
    evidence: NotRequired[Evidence]
    bands: list[Band]
    z_map: ResidualMap
    contrasts: list[Contrast]
    parameters: list[Parameter]
    """Parameters of the base model without and with the leading cause."""
    groups: list[list[str]]
    """Groups of effects that this recording cannot distinguish."""
    warnings: list[str]
    method: dict[str, Any]
    """Computation of the null distribution: number of null samples, seed, trials, repeats, fmax."""
    recordings: NotRequired[Annotated[list[Recording], Field(min_length=2)]]
    """Goodness of fit of each recording under different stimuli that were diagnosed together; absent for
    one recording."""
    nearest: NotRequired[Nearest | None]
    """The nearest mechanism of the library, whatever the verdict, and what it leaves; null without a gap in the mean
    response, or when no mechanism comes near with a size that a body can have. Absent in files of version 1.0.0."""
    answers: NotRequired[dict[str, Any]]
    """Answers to further questions by name, each in its own form; absent where there are none."""


@closed
class NextTrialCause(TypedDict):
    """`cause` of `next_trial`."""

    cause: str
    probability: Probability


@closed
class Decides(TypedDict):
    """Two causes that it tells apart, and the chance that it names the right one; null if it decides nothing."""

    first: str
    second: str
    chance: Probability


@closed
class Beside(TypedDict):
    """Trials of a second kind that are recorded beside these; null for none."""

    stimulus: str
    amplitude: float
    """Peak, in the unit of the stimulus."""
    unit: Literal["N m", "m", "rad"]
    spectrum: Literal["prts", "flat"]
    trials: Number
    cycles: Annotated[int, Field(ge=2)]


@closed
class Option(TypedDict):
    """`option` of `next_trial`."""

    stimulus: str
    amplitude: float
    """Peak, in the unit of the stimulus."""
    unit: Literal["N m", "m", "rad"]
    spectrum: Literal["prts", "flat"]
    trials: Number
    cycles: Annotated[int, Field(ge=2)]
    duration_s: float
    bits: float
    """Expected information about the cause."""
    probability: float
    """Expected posterior probability of the true cause if it acts as one of the hypotheses, with the probabilities of
    causes: much of it may be that nothing is missing."""
    probability_if_missing: NotRequired[Probability]
    """The same if an effect is missing, or a cause outside the library; absent in older files."""
    probability_low: NotRequired[Probability]
    """Lower end of probability: what simulated recordings with all kinds of causes reached on average; absent in older
    files."""
    probability_if_missing_low: NotRequired[Probability]
    """The same of probability_if_missing; absent in older files."""
    set_size: float
    """Expected number of causes in the 95 % set."""
    decides: Decides | None
    beside: NotRequired[Beside | None]


@closed
class NextTrial(TypedDict):
    """Possible next trials after a diagnosis, ranked by expected information about the cause."""

    schema: Literal["mcstudy:next_trial:1.0.0"]
    name: str
    causes: Annotated[list[NextTrialCause], Field(min_length=1)]
    """What is still possible, the most probable first."""
    entropy_bits: float
    """Entropy over the causes before the trial."""
    options: Annotated[list[Option], Field(min_length=1)]
    """Possible trials, the most informative first."""
    twins_before: list[list[str]]
    """Effects that what was recorded cannot distinguish, group by group."""
    twins_after: list[list[str]]
    """The same with the first of the options."""
    inseparable: NotRequired[list[Annotated[list[str], Field(min_length=2, max_length=2)]]]
    """Pairs of the leading causes that none of the options tells apart."""
    effects: NotRequired[list[str]]
    """Effects in the order of the rows and columns of the similarities."""
    similarity_before: NotRequired[list[list[float]]]
    """Largest |cosine| of the residuals that two effects would leave, in what was recorded."""
    similarity_after: NotRequired[list[list[float]]]
    """The same with the first of the options beside it."""
