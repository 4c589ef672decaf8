"""The files of a challenge."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from pipelines.schemas.kinds import Count, NonNegative, Probability, Sha256, Share, closed, further, open_ended

CaseName = Annotated[str, Field(pattern="^case[0-9]+$")]
CASE_FILE = r"^case[0-9]+\.nc$"


@closed
class Program(TypedDict):
    """A program, by its source and the versions of what it uses."""

    source: Sha256
    """SHA-256 of its source"""
    versions: dict[str, str]


@closed
class ChallengeManifest(TypedDict):
    """Data of a challenge. manifest.json of a data folder: its content, and the digest of the key, which is stored
    elsewhere."""

    schema: Literal["mcstudy:challenge_manifest:1.0.0"]
    challenge: str
    description: str
    fingerprint: Sha256
    """SHA-256 of everything in the challenge file that changes a case"""
    key_sha256: Sha256
    program: NotRequired[Program]
    files: Annotated[dict[str, Sha256], Field(json_schema_extra={"propertyNames": {"pattern": CASE_FILE}})]
    """SHA-256 of every recording, by file name"""


@open_ended
class Effect(TypedDict):
    """`effect` of `case`."""

    effect: str
    sizes: Annotated[dict[str, float], Field(min_length=1)]
    """sizes by parameter: the size itself first, then shape parameters"""
    delta: float
    """of this effect alone"""
    group: list[str]
    """effects that cannot be distinguished from it in this recording (chains of |cosine| > 0.95); for a mechanism in
    another form, from the effect as declared; with all effects that change the gains in the same direction with
    amplitude or over time"""
    kin: list[str]
    """similar effects: |cosine| > 0.9"""


@open_ended
class Outsider(TypedDict):
    """an out-of-library effect"""

    name: str
    size: float
    unit: str


@closed
class AnyForm(TypedDict):
    """the same where the shape constants of the effects are free"""

    closable: dict[str, Share]
    nearest: str
    residual_delta: NonNegative
    smooth_residual: NonNegative


@closed
class Case(TypedDict):
    """`case` of `challenge_key`."""

    name: CaseName
    series: str
    """main, or a variant of the challenge file"""
    kind: Literal[
        "none",
        "shifted",
        "near_unstable",
        "known",
        "outsider",
        "pair",
        "misshapen",
        "foreign",
        "foreign_mechanism",
        "foreign_outsider",
    ]
    parameters: dict[str, float]
    """true parameters of the body, in the units of the model"""
    delta: NonNegative
    """root of the noncentrality of all causes together after the model is refitted; for an out-of-library effect, of
    the part that a smooth torque can produce"""
    effects: Annotated[list[Effect], Field(max_length=2)]
    """causes from the library"""
    outsider: NotRequired[Outsider]
    form: NotRequired[str]
    """the form of a misshapen effect, or the mechanism of a foreign body; its shape constants are among the sizes"""
    groups: NotRequired[list[list[str]]]
    """ambiguity groups with more than one member"""
    closable: NotRequired[dict[str, Share]]
    """share of the gap in the mean response that an effect closes without noise, by name; a pair is a+b"""
    nearest: NotRequired[str]
    """the single effect that closes most"""
    residual_delta: NotRequired[NonNegative]
    """delta left after the nearest effect is added"""
    ceiling: NotRequired[dict[str, float]]
    """expected figures of the ideal method on this case"""
    total_delta: NotRequired[NonNegative]
    """for causes without a closed form: delta of the whole residual, including scatter between lines and cycles"""
    smooth_residual: NotRequired[NonNegative]
    """the part of residual_delta that a smooth torque can produce"""
    any_form: NotRequired[AnyForm]


@closed
class ChallengeKey(TypedDict):
    """Key of a challenge. The truth of every case."""

    schema: Literal["mcstudy:challenge_key:1.0.0"]
    challenge: str
    fingerprint: Sha256
    design: dict[str, Any]
    """the resolved challenge file"""
    cases: Annotated[list[Case], Field(min_length=1)]


@open_ended
class AnsweredSize(TypedDict):
    """95 % interval of a parameter."""

    value: float
    low: float
    high: float


@open_ended
class AnsweredCause(TypedDict):
    """A single effect, or two that act together, with its probability."""

    effects: Annotated[list[str], Field(min_length=1)]
    """effects of the library that act together, one or two"""
    group: list[str]
    """effects that the answer cannot distinguish from a single cause"""
    probability: Share
    size: dict[str, AnsweredSize]
    """95 % interval by parameter of the effects"""


@open_ended
class AnsweredClosure(TypedDict):
    """Share of the gap that a cause closes."""

    effects: str
    """the cause that is added, as in credible_set"""
    fraction: float
    low: float
    high: float


ANSWERED = ("detected", "p_value", "none_probability", "unknown_probability", "causes", "credible_set", "closed")
"""What an answer without an error has."""


@further({"oneOf": [{"required": ["error"]}, {"required": list(ANSWERED), "not": {"required": ["error"]}}]})
class Answer(TypedDict):
    """The answer to one case: a diagnosis, or the reason why there is none."""

    name: CaseName
    seconds: NonNegative
    error: NotRequired[str]
    """reason why there is no diagnosis; scored as wrong"""
    detected: NotRequired[bool]
    p_value: NotRequired[Probability]
    none_probability: NotRequired[Share]
    unknown_probability: NotRequired[Share]
    causes: NotRequired[list[AnsweredCause]]
    credible_set: NotRequired[list[str]]
    """smallest set of hypotheses with a probability of 95 %: none, unknown, an effect, or a+b"""
    place: NotRequired[dict[str, float]]
    closed: NotRequired[AnsweredClosure | None]


@closed
class ChallengeAnswers(TypedDict):
    """Answers to a challenge. Exactly one answer per case, in any order. The hypotheses are mutually exclusive, so
    their probabilities sum to at most 1; the remainder to 1 counts as assigned to causes that are not listed, which
    are wrong."""

    schema: Literal["mcstudy:challenge_answers:1.0.0"]
    challenge: str
    manifest_sha256: Sha256
    """SHA-256 of the manifest of the data that are answered"""
    method: str
    """name of the method that answered"""
    program: NotRequired[Program]
    answers: list[Answer]


@open_ended
class Figure(TypedDict):
    """A rate or mean with its 95 % interval."""

    n: Count
    value: float | None
    low: float | None
    high: float | None
    ceiling: float | None
    """oracle bound: mean performance of the ideal method on these cases, or the nominal rate; null when
    there is none"""


@open_ended
class Bin(TypedDict):
    """`bin` of `calibration`."""

    low: float
    high: float
    stated: Probability | None
    """mean stated probability"""
    right: Figure


@open_ended
class Calibration(TypedDict):
    """Calibration of one kind of statement."""

    statement: str
    stated: Probability | None
    """mean stated probability; null without cases, like all that follow"""
    right: Figure
    """fraction of statements that came true"""
    bins: list[Bin]
    """reliability diagram: ten bins of equal width, of which those without statements are left out; a bin contains its
    upper end, the first contains 0 too"""
    error: Probability | None
    """expected calibration error: mean over statements of |fraction that came true - mean probability| of their bin"""
    by_chance: Probability | None
    """mean of this error if the probabilities are calibrated, from 1000 draws of outcomes from the stated
    probabilities"""
    chance_high: Probability | None
    """95 % quantile of these draws"""
    p_value: Probability | None
    """fraction of these draws with an error at least as large"""
    z: float | None
    """Spiegelhalter's statistic, standard normal for calibrated probabilities; null where nearly all are 0 or 1"""
    z_p_value: Probability | None
    """two-sided p-value of z"""


@closed
class OtherShare(TypedDict):
    """`other_share` of `challenge_score`."""

    nulls: Annotated[float, Field(gt=0, lt=1)]
    first: Figure
    none: Figure
    log_loss: NotRequired[Figure]


@open_ended
class Target(Figure):
    """A target and whether it is reached."""

    name: str
    goal: str
    verdict: Literal["reached", "missed", "no cases"]
    certain: bool
    """whether the whole 95 % interval agrees with the verdict"""
    beyond_doubt: bool
    """whether the 99.9 % interval agrees with the verdict, too"""
    percent: bool


@open_ended
class Power(TypedDict):
    """`power` of `challenge_score`."""

    low: float
    high: float | None
    detected: Figure
    top: Figure
    probability: Figure


@open_ended
class CauseFigures(TypedDict):
    """`by_cause` of `challenge_score`."""

    cause: NotRequired[str]
    detected: NotRequired[Figure]
    top: NotRequired[Figure]
    confident_wrong: NotRequired[Figure]


@closed
class ChallengeScore(TypedDict):
    """Score of a challenge. Score of the answers. Rates have Wilson's 95 % interval, means the corresponding score
    interval for bounded values."""

    schema: Literal["mcstudy:challenge_score:1.0.0"]
    challenge: str
    method: str
    key_sha256: NotRequired[Sha256]
    answers_sha256: NotRequired[Sha256]
    cases: int
    errors: list[Any]
    seconds_per_case: float
    proper: dict[str, dict[str, Figure]]
    """proper scores by kind of case; natural logarithm, probabilities below 1e-4 count as 1e-4; the remainder to a sum
    of 1 counts as one more, wrong hypothesis"""
    calibration: NotRequired[list[Calibration]]
    """calibration of stated probabilities: of the most probable hypothesis, that nothing is missing, that the cause is
    outside the library; then of the most probable hypothesis by its kind. An error counts as certain of what is not
    true"""
    other_shares: NotRequired[list[OtherShare]]
    """the same cases weighted so that those without a missing effect have the share nulls: mean stated probability of
    the most probable hypothesis minus how often it is right (first), mean probability of nothing missing minus
    that share (none), and mean log loss; empty without cases of both kinds, absent in older files"""
    targets: list[Target]
    false_alarms: list[Target]
    figures: dict[str, Figure]
    power: list[Power]
    """known single causes by delta"""
    by_cause: list[CauseFigures]
    confusion: dict[str, dict[str, int]]
    """for each true cause, the number of cases by most probable hypothesis"""
