"""Parameters of one person and of many, and the comparison of two groups."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from pipelines.schemas.kinds import Count, NonNegative, Number, Positive, Probability, closed, open_ended


@closed
class Forecast(TypedDict):
    """half-widths that the Fisher information predicts, in the unit of the quantity; null for lines alone"""

    now: float
    """half-width of the interval"""
    cycles: float
    """predicted half-width with twice the cycles"""
    amplitude: float
    """predicted half-width with twice the amplitude"""
    fmax: float | None
    """predicted half-width with the lines up to fmax_hz"""
    fmax_hz: float | None
    known: str
    """parameter whose value from elsewhere would narrow the interval most"""
    with_known: float
    """predicted half-width then"""
    rough: bool
    """whether a bound ends the interval, or the likelihood is far from quadratic"""


@closed
class Coverage(TypedDict):
    """percent of 95 % intervals that hold the truth in simulated recordings; null where not simulated"""

    percent: Annotated[float, Field(ge=0, le=100)]
    """of all bodies"""
    lowest: Annotated[float, Field(ge=0, le=100)]
    """of the body with the fewest"""
    highest: Annotated[float, Field(ge=0, le=100)]
    """of the body with the most"""
    remark: Literal["", "wider than needed", "too narrow"]


@open_ended
class Profile(TypedDict):
    """values of the quantity, ascending, and the increase of the squared residual with each"""

    value: list[float]
    rise: list[float]


@closed
class Quantity(TypedDict):
    """`quantity` of `fit`."""

    name: str
    unit: str
    """empty when unknown"""
    estimate: float
    low: float
    high: float
    low_from: Literal["data", "bound", "not finite", "steps"]
    high_from: Literal["data", "bound", "not finite", "steps"]
    wald_low: float | None
    wald_high: float | None
    verdict: Literal["identifiable", "lower limit only", "upper limit only", "not identifiable"]
    on_bound: NotRequired[bool]
    """whether the estimate of a parameter lies on one of its bounds"""
    low_leans_on: NotRequired[list[str]]
    """other parameters that lie on a bound at the lower end, if the data end the interval there"""
    high_leans_on: NotRequired[list[str]]
    """the same at the upper end"""
    paper_cost: NotRequired[float | None]
    """estimate under the cost function of Goodworth & Peterka (2018), for comparison"""
    moves_with: NotRequired[dict[str, list[float]]]
    """parameters that move along the profile, with their values at its lower and upper end"""
    forecast: NotRequired[Forecast | None]
    coverage: NotRequired[Coverage | None]
    information: list[float | None]
    """share of the information on this quantity in each of the bands that bands_hz divides"""
    profile: Profile


@closed
class Parameters(TypedDict):
    """`parameters` of `fit`."""

    names: list[str]
    lower: list[float]
    upper: list[float]
    correlation: list[list[float | None]]
    """of the Gauss-Newton errors; null for a parameter on a bound"""


@closed
class GoodnessOfFit(TypedDict):
    """`fit` of `fit`."""

    chi2: float
    """squared residual in standard errors of the noise"""
    expected: float
    """its mean for noise alone"""
    p_value: Probability
    lines: Number
    without_effects: float | None
    """chi2 of the best fit without the added effects; null if none were added"""
    growth_rate: float | None
    """of the closed loop at the estimate, 1/s; negative is stable"""


@open_ended
class Minima(TypedDict):
    """`minima` of `search`."""

    rise: NonNegative
    """squared residual above the lowest"""
    hits: Count
    """random starts that ended here"""
    parameters: list[float]


@closed
class Search(TypedDict):
    """`search` of `fit`."""

    starts: Annotated[int, Field(ge=2)]
    missed: Probability
    """expected share of starts that would end in a minimum not seen yet"""
    missed_lowest: NotRequired[Probability]
    """chance that as many new random starts alone miss the lowest minimum; absent in older files and where no random
    start ended there"""
    lowest_from: NotRequired[Literal["random", "linear", "across"]]
    """which starts ended in the lowest minimum: random ones; if none, the one from the linear structure of the
    equations; or else those from the ends of the parameters' ranges; absent in older files"""
    minima: list[Minima]


@closed
class Combination(TypedDict):
    """`combination` of `valley`."""

    name: str
    unit: str
    estimate: float
    low: float
    high: float
    low_from: Literal["data", "bound", "not finite", "steps"]
    high_from: Literal["data", "bound", "not finite", "steps"]
    opposite: str
    opposite_low: float
    opposite_high: float


@closed
class Valley(TypedDict):
    """`valley` of `fit`."""

    names: list[str]
    first: list[float]
    """their values in a body that fits as well as the best one"""
    second: list[float]
    """the same at the other end"""
    combinations: list[Combination]
    """combinations of two of them that the recording determines, and the opposite ones"""


@closed
class FitCoverage(TypedDict):
    """simulated recordings that coverage is of, the nearest in cycles, fmax and RMS of the torque; null where not
    simulated"""

    cycles: Annotated[int, Field(ge=2)]
    """of each of two trials"""
    fmax: float
    """highest frequency, Hz"""
    amplitude: NotRequired[Positive]
    """peak of the torque, N m; absent in older files, where it is 5"""
    realizations: Number
    """simulated recordings"""


@closed
class Range(TypedDict):
    """`range` of `stability`."""

    name: str
    low: float
    """smallest value of a stable body"""
    high: float
    """Of one angle."""
    whole: bool
    """whether all bodies of the profile are stable"""


@closed
class Stability(TypedDict):
    """of the closed loop; null for lines alone"""

    growth: float
    """real part of the rightmost characteristic root at the estimate, 1/s"""
    frequency_hz: float
    """frequency of that root"""
    low: float
    """smallest real part over the intervals"""
    high: float
    """Of one angle."""
    ranges: list[Range]


@closed
class Angle(TypedDict):
    """`angle` of `sway`."""

    angle: str
    stimulus: float
    """RMS sway that the stimulus evokes, deg, predicted at the estimate"""
    stimulus_low: float
    """smallest over the intervals"""
    stimulus_high: float
    """Of one angle."""
    measured: float
    """the measured one, noise subtracted"""
    measured_se: float
    """its standard error"""
    noise: float | None
    """RMS sway that sensor noise evokes, deg; null without a period"""
    noise_low: float | None
    noise_high: float | None
    noise_measured: float | None


@closed
class Sway(TypedDict):
    """predicted and measured sway; null for a published response"""

    angles: list[Angle]
    noise_levels: list[float] | None
    """power of both sensor noises relative to Goodworth & Peterka (2018)"""


@closed
class AveragedCause(TypedDict):
    """a cause and its weight; no effects: nothing is missing"""

    effects: list[str]
    probability: Probability


@closed
class AveragedQuantity(TypedDict):
    """a quantity of the model as it is, and averaged over causes"""

    name: str
    unit: str
    base: float
    base_low: float
    base_high: float
    estimate: float
    """median of the average"""
    low: float
    high: float
    low_from: Literal["data", "bound"]
    high_from: Literal["data", "bound"]
    data: float
    """share of the variance that noise makes where cause and form are known"""
    form: float
    """share of the forms of one cause"""
    cause: float
    """share of which cause it is"""
    moved_by: str
    """cause that moved it most; empty where none did"""
    determined: bool


@closed
class Averaged(TypedDict):
    """quantities averaged over what the model may lack"""

    causes: list[AveragedCause]
    quantities: list[AveragedQuantity]


@closed
class Gap(TypedDict):
    """test for a gap, as of mcstudy gap diagnose --fast; null for lines alone"""

    p_value: Probability
    p_least: float
    """smallest p-value that the null samples can give"""


@closed
class Comparison(TypedDict):
    """Comparison of two groups. the model with the added effects against that without; null if none were added"""

    effects: list[str]
    log_bayes_factor: float
    """ln evidence with the effects minus without"""
    unseen: float | None
    """squared residual of unseen cycles, without minus with the effects"""
    unseen_se: float | None


@closed
class Recording(TypedDict):
    """`recording` of `fit`."""

    name: str
    lines: Number
    chi2: float
    expected: float
    """mean of chi2 for noise alone"""
    p_value: Probability


@closed
class Fit(TypedDict):
    """Parameters of one person. Result of mcstudy fit: estimates with profile likelihood intervals. Numbers that are
    not defined are null."""

    schema: Literal["mcstudy:fit:1.0.0"]
    name: str
    level: Annotated[float, Field(ge=0.5, lt=1)]
    """level of the intervals"""
    quantities: Annotated[list[Quantity], Field(min_length=1)]
    bands_hz: list[float]
    parameters: Parameters
    fit: GoodnessOfFit
    search: Search
    valleys: NotRequired[list[Valley]]
    """groups of parameters that trade for each other"""
    coverage: NotRequired[FitCoverage | None]
    stability: NotRequired[Stability | None]
    sway: NotRequired[Sway | None]
    gap: NotRequired[Gap | None]
    averaged: NotRequired[Averaged]
    comparison: NotRequired[Comparison | None]
    warnings: list[str]
    method: dict[str, Any]
    recordings: NotRequired[Annotated[list[Recording], Field(min_length=2)]]
    """goodness of fit of each recording under different stimuli that were fitted together; absent for one recording"""


@closed
class Sharing(TypedDict):
    """`sharing` of `conditions`."""

    name: str
    unit: str
    separate: bool
    """whether it has a value in each condition in the fit"""
    conditions: Annotated[list[str], Field(min_length=2)]
    """those that hold it"""
    values: list[float]
    """where each condition has one"""
    half_widths: list[float | None]
    """of their Wald intervals; null on a bound"""
    ratio: float
    """twice the log likelihood ratio without and with sharing"""
    p_value: Probability
    """of that, where conditions share it"""
    unseen: float | None
    """squared residual of unseen cycles, shared minus separate; null without cycles"""
    unseen_se: float | None


@closed
class Conditions(TypedDict):
    """Parameters of one person in several conditions. Result of mcstudy fit --per: estimates with profile likelihood
    intervals, and tests of what the conditions share. Numbers that are not defined are null."""

    schema: Literal["mcstudy:conditions:1.0.0"]
    conditions: Annotated[list[str], Field(min_length=2)]
    separate: list[str]
    """parameters with a value in each condition"""
    sharing: list[Sharing]
    fit: Fit
    """of all conditions; a separate parameter is there for each condition, under its name and that of the condition"""


@closed
class Individual(TypedDict):
    """`individual` of `mean`."""

    person: str
    estimate: float
    """of this person's own fit"""
    low: float
    high: float
    low_from: Literal["data", "bound", "not finite", "steps"]
    high_from: Literal["data", "bound", "not finite", "steps"]
    shrunken: float | None
    """given the other people too; null for fewer than three people"""
    shrunken_low: float | None
    shrunken_high: float | None


@closed
class Mean(TypedDict):
    """`mean` of `group`."""

    quantity: str
    unit: str
    """empty when unknown"""
    condition: str
    mean: float
    """of the population"""
    low: float
    high: float
    low_from: Literal["data", "bound", "flat"]
    high_from: Literal["data", "bound", "flat"]
    between: Positive | None
    """standard deviation between people, without errors of the fits; null where these explain all scatter, so that it
    may be zero and is at most between_high"""
    between_low: float
    between_high: float
    between_low_from: Literal["data", "bound", "flat"]
    between_high_from: Literal["data", "bound", "flat"]
    verdict: Literal["determined", "lower limit only", "upper limit only", "not determined"]
    individuals: Annotated[list[Individual], Field(min_length=2)]


@closed
class Difference(TypedDict):
    """`difference` of `group`."""

    quantity: str
    unit: str
    condition: str
    reference: str
    paired: bool
    people: Annotated[list[Annotated[int, Field(ge=2)]], Field(min_length=2, max_length=2)]
    """numbers in condition and reference"""
    difference: float
    """mean in condition minus mean in reference"""
    low: float
    high: float
    low_from: Literal["data", "bound", "flat"]
    high_from: Literal["data", "bound", "flat"]
    p_value: Probability
    """of no difference: 1 minus the level of the interval that ends at zero"""
    verdict: Literal["determined", "lower limit only", "upper limit only", "not determined"]


@closed
class PersonFit(TypedDict):
    """`fit` of `group`."""

    person: str
    condition: str
    name: str
    """of the recording"""
    p_value: Probability
    """of the fit"""
    lines: Number


@closed
class Failed(TypedDict):
    """`failed` of `group`."""

    person: str
    condition: str
    reason: str


@closed
class Group(TypedDict):
    """Parameters of many people. Result of mcstudy fit --group: means, spread between people and differences between
    conditions. Numbers that are not defined are null."""

    schema: Literal["mcstudy:group:1.0.0"]
    level: Annotated[float, Field(ge=0.5, lt=1)]
    """level of the intervals"""
    conditions: Annotated[list[str], Field(min_length=1)]
    """the first is the reference of differences"""
    paired: bool
    """whether differences are within people"""
    means: Annotated[list[Mean], Field(min_length=1)]
    differences: list[Difference]
    fits: Annotated[list[PersonFit], Field(min_length=2)]
    failed: list[Failed]
    warnings: list[str]


@closed
class Response(TypedDict):
    """complex response of lower and upper body at every frequency"""

    real: Annotated[list[list[float]], Field(min_length=2, max_length=2)]
    imaginary: Annotated[list[list[float]], Field(min_length=2, max_length=2)]


@closed
class Region(TypedDict):
    """`region` of `detection`."""

    segment: Literal["lower", "upper"]
    band: str
    low: float
    """first point, Hz"""
    high: float
    """last point, Hz"""
    gain: float
    """ratio of mean responses, b over a"""
    phase_deg: float
    """b minus a"""
    p: Probability
    """of equal means in this region, corrected for all regions by closed tests; at least p_mean"""


@closed
class Detection(TypedDict):
    """`detection` of `comparison`."""

    p_mean: Probability
    """of equal mean responses at all points; the decision: causes are only named where it is at most 0.05"""
    p_ratio: Probability
    """of equal responses of the upper body relative to the lower; at least p_mean"""
    p_scatter: Probability
    """of equal scatter between people, a question of its own"""
    scatter_ratio: Positive
    """variance between people, b over a"""
    regions: list[Region]
    relabellings: Annotated[int, Field(ge=2)]
    """number of groups compared, the observed pair among them; all different ones where these are no more than were
    asked for"""
    least_p: Probability
    """smallest p-value that these people and relabellings allow"""


@closed
class Parameter(TypedDict):
    """`parameter` of `cause`."""

    name: str
    a: float
    b: float


@closed
class Cause(TypedDict):
    """`cause` of `comparison`."""

    name: str
    probability: Probability
    """given the data and that the means differ"""
    closed: float | None
    """share of the difference closed in people not used for it; null when not computed"""
    closed_se: float | None
    """its standard error"""
    parameters: list[Parameter]


@closed
class GroupComparison(TypedDict):
    """Comparison of two groups. Result of mcstudy gap compare: what differs between two groups of people, where, and
    which parameter changed. Angles are in space, lower body first; responses are in rad per unit of the stimulus."""

    schema: Literal["mcstudy:comparison:1.0.0"]
    a: str
    """name of the first group"""
    b: str
    """name of the second group"""
    people: Annotated[list[Number], Field(min_length=2, max_length=2)]
    """of both groups; the number of pairs when paired"""
    paired: bool
    """whether people are compared with themselves"""
    stimulus: str
    """kind of stimulus"""
    permutations: Number
    """relabellings of the tests"""
    inflation: Annotated[float, Field(ge=1)] | None
    """factor of the error of the difference in the evidence; null where no difference was found"""
    verdict: str
    notes: NotRequired[list[str]]
    """what was left out of the recordings, and why"""
    kind: Literal["same", "alike", "upper body"]
    """same: no difference found; alike: both segments change by one factor; upper body: their ratio changes"""
    frequency: list[float]
    """of the points, Hz"""
    mean_a: Response
    mean_b: Response
    error_a: Annotated[list[list[float]], Field(min_length=2, max_length=2)]
    """standard error of the mean response, root of E|error|^2"""
    error_b: Annotated[list[list[float]], Field(min_length=2, max_length=2)]
    """the same of b"""
    predicted_difference: Response | None
    """of b minus a, by the most probable named change; null where no difference was found"""
    detection: Detection
    causes: list[Cause]
    """hypotheses by probability; none where no difference of the means was found"""
