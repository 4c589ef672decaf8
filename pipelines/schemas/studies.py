"""What is known of a study: progress, verification, solutions, designed stimuli."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from pipelines.schemas.kinds import Count, NonNegative, Number, Positive, Probability, Sha256, closed


@closed
class Group(TypedDict):
    """`group` of `status`."""

    pending: Count
    """not run yet"""
    converged: Count
    stalled: Count
    """no step improves the cost further"""
    iteration_limit: Count
    non_finite_model: Count
    non_finite_data: Count
    solver_error: Count
    not_needed: NotRequired[Count]
    """starts left out because those before them sufficed (starts = "until certain"); absent in older files"""
    unstable: NotRequired[Count]
    """no stable loop was found (`stability_margin`); absent in older files"""


@closed
class Status(TypedDict):
    """Progress of a results cube. Numbers of fits by how they ended, for each group of the study. Fits of a damaged or
    missing chunk count as pending."""

    schema: Literal["mcstudy:status:1.0.0"]
    study: Annotated[str, Field(min_length=1)]
    """name of the study"""
    fingerprint: Sha256
    """SHA-256 of the study"""
    groups: Annotated[dict[str, Group], Field(min_length=1)]


@closed
class OtherEnvironment(TypedDict):
    """cells computed in another environment that came out otherwise here; null where there is none. Differences are the
    largest, and relative; null is infinite: one of both has no number"""

    within: bool
    """whether data and cost_there are within the tolerance in every cell"""
    tolerance: Positive
    cells: Count
    fits: Count
    """fits that were run again in these cells"""
    ends: Count
    """of them, those that ended at the same cost and parameters within the tolerance; a search may end elsewhere after
    the first rounding error"""
    data: NonNegative | None
    """of the responses and their noise, relative to the largest of the cell"""
    cost_there: NonNegative | None
    """of a stored cost from the cost, here, of the stored estimate"""
    cost: NonNegative | None
    """of the costs at which a fit ended"""
    parameter: NonNegative | None
    """of a parameter at which a fit ended, relative to the width of its bounds"""


@closed
class Verification(TypedDict):
    """Check of a results cube. What `mcstudy verify` found: damage, and values that were computed in another
    environment and do not come out bit for bit here."""

    schema: Literal["mcstudy:verification:1.0.0"]
    damage: list[str]
    """one line per damaged file or per cell of this environment that does not come out again"""
    notes: list[str]
    """what is no damage: the environments that differ from this one, chunks without checksums"""
    beyond: list[str]
    """one line per cell computed in another environment that differs from what comes out here by more than the
    tolerance"""
    other_environment: OtherEnvironment | None
    chunks: Count
    """chunks read"""
    recomputed: Count
    """fits run again"""
    pending: Count
    """fits not run yet"""
    sha256: Sha256
    """of names and contents of all files of the cube"""


@closed
class Design(TypedDict):
    """A design of the experiment."""

    cycles: Number
    amplitude: Positive
    fmax: Positive
    realizations: NotRequired[Number]


@closed
class Answer(TypedDict):
    """The design that reaches the targets."""

    cycles: Number
    amplitude: Positive
    fmax: Positive
    realizations: Number


@closed
class Crossing(TypedDict):
    """`crossing` of `solution`."""

    value: float | None
    interval: list[float | None]
    at_start: bool
    """whether the interval begins with the range that was allowed"""
    at_end: bool
    """whether the interval ends with the range that was allowed"""


@closed
class Measure(TypedDict):
    """`measure` of `solution`."""

    target: str
    unit: str
    value: float | None
    interval: list[float | None]
    linear_theory: float | None
    """the closed form without bounds on the parameters"""
    cramer_rao: float | None


@closed
class BestByFmax(TypedDict):
    """`by_fmax` of `solution`."""

    fmax: Positive
    cycles: Number
    amplitude: Positive
    reached: bool
    cost: float | None
    cost_interval: list[float | None]
    control: str
    """kind of the cheap fits: truth, linearised, or full for none"""
    relative_cost: float
    """expected cost of the estimates, relative to complete fits alone"""


@closed
class Look(TypedDict):
    """`look` of `solution`."""

    cycles: Number
    amplitude: Positive
    fmax: Positive
    realizations: Number
    """fitted from all starts"""
    draws: Count
    """fitted with the control alone"""
    ratio: list[float | None]
    ratio_mcse: list[float | None]


@closed
class Solution(TypedDict):
    """The cheapest design that reaches targets. Result of mcstudy solve. Numbers that are not defined are null."""

    schema: Literal["mcstudy:solution:1.0.0"]
    study: str
    group: str
    seed: Count
    targets: Annotated[list[str], Field(min_length=1)]
    cost_of: str
    """what is minimised"""
    over: dict[str, list[float | None]]
    """axes that were searched: smallest and largest value; for fmax every value, Hz"""
    reached: bool
    """whether an allowed design reaches the targets"""
    flat: NotRequired[bool]
    """whether the measure is known as precisely as asked, but not where it meets the target, because it changes less
    than the axis"""
    decided: bool
    """false where the budget of fits was spent before the answer was as precise as asked"""
    design: Answer | None
    """the answer; null where there is none"""
    cost: float | None
    recording_s: Positive
    """duration of all cycles of the nearest design, s"""
    nearest: Design
    """the answer, or the design that comes nearest to the targets"""
    crossings: dict[str, Crossing]
    """by axis: where the targets are met with the others as in the answer, and its 95 % interval"""
    measures: list[Measure]
    """every target's measure at the nearest design, in the unit of the target"""
    by_fmax: list[BestByFmax]
    looks: list[Look]
    """designs that were fitted; ratio: every measure relative to its target"""
    fits: Count
    evaluations: Count
    """of the model with its derivatives"""


@closed
class Lines(TypedDict):
    """[stimulus.lines] of a study file"""

    harmonic: Annotated[list[Number], Field(min_length=1)]
    weight: Annotated[list[float | None], Field(min_length=1)]
    phase_deg: Annotated[list[float | None], Field(min_length=1)]


@closed
class Spectrum(TypedDict):
    """squared moduli of the Fourier coefficients of one cycle at the odd lines"""

    frequency_hz: Annotated[list[float | None], Field(min_length=1)]
    sequence: Annotated[list[float | None], Field(min_length=1)]
    design: Annotated[list[float | None], Field(min_length=1)]
    detection: list[bool]
    """lines left empty to detect nonlinearities"""


@closed
class Size(TypedDict):
    """`size` of `stimulus_design`."""

    rms: float
    peak: float
    rate_rms: float
    crest_factor: Annotated[float, Field(ge=1)]
    sway_rms_deg: NotRequired[Annotated[list[float | None], Field(min_length=1)]]
    sway_rms: NotRequired[Annotated[list[float | None], Field(min_length=1)]]
    """of a declared model whose outputs are not in rad, in their units"""


@closed
class Pair(TypedDict):
    """With the sequence and with the design."""

    sequence: Annotated[list[float | None], Field(min_length=1)]
    design: Annotated[list[float | None], Field(min_length=1)]


@closed
class Difference(TypedDict):
    """`difference` of `stimulus_design`."""

    effect: str
    sizes: dict[str, float]
    sequence: NonNegative
    design: NonNegative


@closed
class OtherBodies(TypedDict):
    """evoked sway RMS, design over sequence, of the angle with the most, in bodies drawn from the prior that neither
    the optimum nor its calibration knew; within: share that keeps limits.sway, with its 95 % interval; absent in
    older files"""

    drawn: Number
    within: Probability
    low: Probability
    high: Probability
    median: NonNegative
    percentile_95: NonNegative
    largest: NonNegative


@closed
class Spread(TypedDict):
    """Spread of the estimates with the sequence and with the design."""

    cost: Literal["ml", "paper"]
    fmax_hz: float
    realizations: Annotated[int, Field(ge=3)]
    cv: Pair
    bias: Pair
    """mean error over true value"""
    at_bound: Pair
    """share of best fits with the parameter on a bound"""
    ratio: Annotated[list[float | None], Field(min_length=1)]
    """of the standard deviations, sequence over design, by parameter"""
    ratio_error: Annotated[list[float | None], Field(min_length=1)]
    """standard error of ratio"""
    mean_ratio: float | None
    """geometric mean of ratio"""
    mean_ratio_error: float | None


@closed
class Body(TypedDict):
    """`body` of `stimulus_design`."""

    predicted_ratio: float
    """geometric mean of the predicted ratios of the SDs with bounds, sequence over design"""
    sway_ratio: float
    """largest ratio of evoked sway RMS of the angles, design over sequence"""
    found: Spread | None
    """null without verification"""


@closed
class StimulusDesign(TypedDict):
    """A designed stimulus. Result of mcstudy design: the lines of the stimulus, predicted errors, and the Monte Carlo
    study of design and sequence. Numbers that are not defined are null."""

    schema: Literal["mcstudy:stimulus_design:1.0.0"]
    design_file: dict[str, Any]
    """the design file with all defaults written out"""
    stimulus_unit: str
    cycles: Number
    """recorded cycles"""
    period_s: Positive
    amplitude: Positive
    """of the waveform, as stimulus.convention of the design file reads it"""
    lines: Lines
    spectrum: Spectrum
    optimality_gap: float
    """upper bound on what any allowed spectrum gains in the criterion"""
    limits_used: dict[str, NonNegative]
    """share of each limit that the design uses, in power; sway: of the body of the file, or of the one in whom a share
    limits.bodies_within of the bodies sway less"""
    size: Annotated[dict[str, Size], Field(json_schema_extra={"required": ["sequence", "design"]})]
    noise_sway_rms_deg: NotRequired[Annotated[list[float | None], Field(min_length=1)]]
    noise_sway_rms: NotRequired[Annotated[list[float | None], Field(min_length=1)]]
    """of a declared model whose outputs are not in rad, in their units"""
    """RMS sway of the noise alone"""
    parameters: Annotated[list[str], Field(min_length=1)]
    predicted_cv: Pair
    """coefficients of variation at the Cramer-Rao bound, without bounds"""
    predicted_cv_with_bounds: Pair
    """the same with the information of a normal prior that has the variance of the box of allowed values"""
    differences: NotRequired[Annotated[list[Difference], Field(max_length=2)]]
    """of the criterion 'difference': every effect with its sizes, and the distance of the responses from all that the
    model can give without it, in standard deviations; absent in older files"""
    other_bodies: NotRequired[OtherBodies]
    verification: list[Spread]
    """best fits for the body of the design file; empty without verification"""
    bodies: list[Body]
    """bodies drawn from the prior, that the design did not know"""
