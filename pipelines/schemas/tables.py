"""The tables of a results cube."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from pipelines.schemas.kinds import Count, NonNegative, Number, closed, open_ended


@closed
class Study(TypedDict):
    """`study` of `show`."""

    title: str | None
    fingerprint: str | None
    seed: int | None


@closed
class Row(TypedDict):
    """A number or ranking of the paper and ours."""

    key: str
    label: str
    unit: str
    where: str
    """figure, table or section of the paper"""
    criterion: Literal["equal", "at most", "at least", "none"]
    """what the paper says of the number: ours equals it; is no larger; is no smaller (a ranking: ours is the margin by
    which it holds, and the number is 0); nothing to compare with"""
    paper: float | None
    paper_text: str
    half_unit: NonNegative
    """half a unit of the last digit that the paper quotes, or what 'about' leaves open"""
    margin: float | None
    """margin of equivalence, for criterion equal"""
    value: float | None
    """ours: mean over blocks of the paper's number of realizations"""
    mcse: float | None
    low: float | None
    """with high: range of ours over the readings of a definition that the paper does not give"""
    high: float | None
    n: Count
    """number of realizations, pools or blocks of starts behind our value"""
    blocks: Number
    """number of blocks of the paper's size"""
    floor: float | None
    group: str
    verdict: Literal["agrees", "cannot tell", "differs", None]
    """agrees: the 90 % interval of the difference is within the margin; differs: further apart than three standard
    errors of the difference (3.75 from fewer than 20 blocks), beyond the rounding; null: the paper gives nothing to
    compare with"""
    distance: float | None
    """difference, less half_unit, in standard errors of both studies"""
    paper_mcse: float | None
    """standard error of the paper's number: that of a study of its size if its model were ours"""
    needed: int | None
    """realizations of ours that would tell, if our value stays"""
    limited_by: Literal["realizations", "paper's error", "definition", None]
    """why it cannot be told: too few realizations of ours; the paper's own error, so that no number of ours would tell;
    a definition that the paper does not give"""
    detail: str
    explanation: str
    """what is known about the difference of a row that differs; else empty"""


@closed
class Paper(TypedDict):
    """`paper` of `show`."""

    reference: str
    rows: list[Row]


@closed
class Statistic(TypedDict):
    """A number and its Monte Carlo standard error; null where it does not exist (too few realizations). floor: absolute
    bias expected from chance alone, for unbiased estimates. lower, upper: 95 % interval."""

    value: float | None
    mcse: float | None
    floor: NotRequired[float | None]
    lower: NotRequired[float | None]
    upper: NotRequired[float | None]
    used: NotRequired[NonNegative | None]
    """realizations with a standard error, in the measures of standard errors; absent elsewhere"""


@closed
class Cell(TypedDict):
    """`cell` of `comparison`."""

    fmax: float
    """Hz"""
    bias: Statistic
    """difference of: mean |bias| of the parameters, % of the truth"""
    spread: Statistic
    """difference of: mean SD of the parameters, % of the truth"""
    rmse: Statistic
    """difference of: mean root mean squared error of the parameters, % of the truth"""
    unstable: Statistic
    """difference of: best fits that are unstable, %"""
    on_bound: Statistic
    """difference of: estimates that lie on a bound, %"""
    hits: Statistic
    """difference of: starts that reach the lowest cost of their cell, %"""
    frf_error: Statistic
    """difference of: mean distance of the mean FRF from the closed form, % of its magnitude"""
    frf_spread: Statistic
    """difference of: mean SD of the FRF, % of its magnitude"""


@closed
class Claim(TypedDict):
    """`claim` of `comparison`."""

    claim: str
    where: str
    measure: Literal["bias", "spread", "rmse", "unstable", "on_bound", "hits", "frf_error", "frf_spread"]
    expected: Literal["higher", "lower"]
    fmax: float
    value: float | None
    mcse: float | None
    verdict: Literal["agrees", "contradicts", "undecided"]
    """by more than 3 standard errors"""


@closed
class Comparison(TypedDict):
    """group minus reference, averaged over amplitudes, with the error of the difference"""

    reference: str
    group: str
    differences: list[str]
    """settings of the group that differ from the reference's"""
    amplitudes: list[float]
    """amplitudes averaged over"""
    realizations: Count
    """number of common realizations; the smaller number of the two if they are not paired"""
    paired: bool
    """whether both were fitted to the same noise, realization by realization (the same seed); else the two are
    independent"""
    cells: list[Cell]
    claims: list[Claim]
    """claims of the paper about this change"""


@closed
class Design(TypedDict):
    """`design` of `group`."""

    simulator: str
    realizations: Count
    starts: Count
    until_certain: NotRequired[bool]
    """whether starts is the largest number, and those that were not needed were left out; absent in older files"""
    fmax: list[float]
    """Hz"""
    amplitude: list[float]
    amplitude_unit: str
    convention: str
    model: str
    cost: str
    solver: str
    points: str
    ramp: str
    width: float
    """fraction of a point's lines that are averaged"""
    noise: bool
    """whether realizations differ by noise; else they are pools of starts for the same data"""


@closed
class Realizations(TypedDict):
    """`realizations` of `cell`."""

    used: Count
    not_run: Count
    non_finite: Count
    """data or weights not finite: nothing fitted"""
    diverged: Count
    """model not finite from any start"""
    failed: Count


@closed
class Efficiency(TypedDict):
    """Cramér-Rao variance divided by the observed variance; 1 is the optimum"""

    value: float | None
    """null where the Cramér-Rao bound does not apply, or where the bounds of the fit determine the parameter"""
    mcse: float | None
    applies: bool
    """whether the Cramér-Rao bound applies: at least nine best fits in ten of this amplitude and Fmax are
    on no bound"""
    box: NotRequired[float | None]
    """bound of van Trees on the mean squared error within the box of allowed values, divided by the observed mean
    squared error; it also holds where the Cramér-Rao bound does not apply. Absent in older files"""
    box_mcse: NotRequired[float | None]
    held: bool
    """whether the bounds of the fit determine the parameter, or one of the parameters of the sum: the change from one
    bound to the other changes the responses by less than a thousandth of their noise"""


@closed
class Parameter(TypedDict):
    """bias, sd and rmse in the parameter's unit; at_*_bound are fractions, absent for combined stiffnesses; efficiency
    is absent where the noise is not known; model_se, se_relative_error and coverages only for a cube with standard
    errors; median_bias, mad (median absolute deviation) and quantiles of the estimates in the parameter's unit,
    absent in older files and for combined stiffnesses"""

    name: str
    unit: str
    truth: float | None
    bias: Statistic
    absolute_bias_percent: Statistic
    sd: Statistic
    cv: Statistic
    rmse: Statistic
    at_lower_bound: NotRequired[Statistic]
    at_upper_bound: NotRequired[Statistic]
    efficiency: NotRequired[Efficiency]
    model_se: NotRequired[Statistic]
    se_relative_error: NotRequired[Statistic]
    coverage: NotRequired[Statistic]
    bias_eliminated_coverage: NotRequired[Statistic]
    median_bias: NotRequired[Statistic]
    mad: NotRequired[Statistic]
    quantile_05: NotRequired[Statistic]
    quantile_95: NotRequired[Statistic]


@open_ended
class GroupCell(TypedDict, extra_items=Statistic):
    """The fits of one amplitude and Fmax; further keys are statistics that later programs have."""

    amplitude: float
    fmax: float
    """Hz"""
    realizations: Realizations
    hit_rate: float | None
    """mean fraction of starts that reach the lowest cost of their cell"""
    mean_absolute_bias_percent: Statistic
    mean_spread_percent: Statistic
    unstable: Statistic
    inside_bounds: Statistic
    median_cost: Statistic
    median_j_nc: Statistic
    missed_minimum: Statistic
    """chance that as many new starts miss the lowest cost, and so that these missed a lower one: mean over
    realizations. Right on average over many realizations, orders too small in a single one and below 1 %"""
    missed_minimum_upper: NotRequired[Statistic]
    """limit of that chance also in a single realization: upper ends of 95 % intervals, none below the 1 % that stopping
    rules promise, mean over realizations; absent in older files"""
    starts_needed_median: Statistic
    starts_needed_90th: Statistic
    mean_absolute_bias_percent_combined: NotRequired[Statistic]
    mean_spread_percent_combined: NotRequired[Statistic]
    parameters: list[Parameter]


@closed
class SweepCell(TypedDict):
    """Where a group lies in a sweep; absent in other groups."""

    sweep: str
    at: dict[str, str | float | bool]
    """the label on every axis"""


@closed
class Group(TypedDict):
    """A group of the study."""

    design: Design
    cell: NotRequired[SweepCell]
    differences: list[str]
    """settings that differ from the paper's"""
    truth_provenance: str
    """origin of the true values; must be shown wherever they are shown"""
    notes: NotRequired[list[str]]
    """notes to be read first: an unstable true body, and missing numbers, with amplitude and Fmax; absent in older
    files"""
    fits: dict[str, Count]
    """number of fits by status"""
    cells: list[GroupCell]


@closed
class Show(TypedDict):
    """What `mcstudy show --json` prints. Statistics of a results cube, each with its Monte Carlo standard error, beside
    the published numbers of Goodworth & Peterka 2018 where the study has the same Fmax and amplitudes. null: the
    number does not exist."""

    schema: Literal["mcstudy:show:2.0.0"]
    study: Study
    paper: Paper
    comparisons: list[Comparison]
    """groups that differ from the study's reference group in a setting, compared realization by realization; or, with
    --compare, groups of this study compared with those of another"""
    not_compared: dict[str, str]
    """with --compare: groups that cannot be compared with the other study's, and why"""
    groups: dict[str, Group]
