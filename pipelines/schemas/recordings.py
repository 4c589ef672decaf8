"""Recordings, and results of the examples."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired

from pydantic import Field, WithJsonSchema
from typing_extensions import TypedDict

from pipelines.schemas.kinds import NonNegative, Number, Positive, further, open_ended

TrialTime = Annotated[list[str], WithJsonSchema({"const": ["trial", "time"]})]
TrialTimeAngle = Annotated[list[str], WithJsonSchema({"const": ["trial", "time", "angle"]})]
ByTrial = Annotated[list[str], WithJsonSchema({"const": ["trial"]})]
Numbers = Annotated[list[float], Field(min_length=1, max_length=10000)]


@open_ended
class Sizes(TypedDict):
    """`sizes` of `recording`."""

    trial: Number
    time: Annotated[int, Field(ge=10)]
    angle: Number
    """of a standing body theta1 (lower body in space), theta2 (hip), in this order; of a declared model its outputs,
    which the coordinate `angle` names (in Zarr the attribute `angles`)"""


@open_ended
class Stimulus(TypedDict):
    """the stimulus in the unit of its kind (N m, m or rad), or of the declared model"""

    dims: TrialTime
    dtype: Literal["float64"]
    units: str


@open_ended
class Theta(TypedDict):
    """joint angles, written in rad, of which a reader also takes deg and mrad; or the outputs of the declared model in
    their units"""

    dims: TrialTimeAngle
    dtype: Literal["float64"]
    units: str


@open_ended
class Amplitude(TypedDict):
    """stated amplitude of each trial, as defined by `convention`; NaN when none is stated"""

    dims: ByTrial
    dtype: Literal["float64"]
    units: str


@open_ended
class Samples(TypedDict):
    """number of valid samples of each trial"""

    dims: ByTrial
    dtype: Literal["int64"]


@open_ended
class Variables(TypedDict):
    """`variables` of `recording`."""

    stimulus: Stimulus
    theta: Theta
    amplitude: Amplitude
    samples: Samples


@open_ended
class Attrs(TypedDict):
    """`attrs` of `recording`."""

    schema: Literal["mcstudy:recording:1.0.0"]
    name: str
    provenance: str
    person: NotRequired[str]
    """who was recorded; absent when not stated"""
    condition: NotRequired[str]
    """in which condition; absent when not stated"""
    rate_hz: Positive
    """sampling rate, Hz"""
    period_s: NotRequired[Positive]
    """period of the stimulus, s; absent when it is not periodic"""
    stimulus_kind: Literal[
        "ankle_torque", "hip_torque", "platform_translation", "surface_tilt", "visual_tilt", "stimulus"
    ]
    """`stimulus` is that of a declared model"""
    convention: Literal["peak", "peak_to_peak"]
    model: NotRequired[Annotated[str, Field(json_schema_extra={"contentMediaType": "application/json"})]]
    """JSON text: the declared model whose outputs were measured, as `model`; absent for a standing body"""
    constants: NotRequired[Annotated[str, Field(json_schema_extra={"contentMediaType": "application/json"})]]
    """JSON text: numbers of the person that the declared model took in place of its own, by name (J, mgh); absent for
    none"""
    body: NotRequired[Annotated[str, Field(json_schema_extra={"contentMediaType": "application/json"})]]
    """of a standing body; JSON text: J1, J2, C1, C2 in kg m^2, A1, A2 in kg m, g in m/s^2 (linearised two-segment body;
    the ankle row is the whole-body balance)"""


@open_ended
class Recording(TypedDict):
    """A recording. Header of a recording as NetCDF or Zarr: dimensions, variables and attributes. `time` counts samples
    from the start of each trial; shorter trials are padded with NaN up to `time`, and `samples` is the number of
    valid samples."""

    sizes: Sizes
    variables: Variables
    attrs: Attrs


@open_ended
class Controller(TypedDict):
    """`controller` of `estimator`."""

    off: Numbers
    """error of the mean estimate by frequency, %"""
    chance: Numbers
    """the same, expected from chance alone for an unbiased estimator with this scatter, %"""
    single: Numbers
    """root-mean-square error of one experiment, %"""


@open_ended
class Estimator(TypedDict):
    """`estimator` of `alternative`."""

    name: Annotated[str, Field(max_length=100)]
    stimuli: Number
    """stimuli in each of its experiments"""
    controllers: Annotated[dict[str, Controller], Field(min_length=1, max_length=10)]


@open_ended
class Route(TypedDict):
    """mean error over populations with its Monte Carlo standard error, and its standard deviation, %"""

    bias: float
    mcse: NonNegative
    sd: NonNegative


@open_ended
class Difference(TypedDict):
    """fit to the mean minus mean of fits, paired, %"""

    value: float
    mcse: NonNegative


@open_ended
class Row(TypedDict):
    """`row` of `alternative`."""

    name: Annotated[str, Field(max_length=100)]
    mean_of_fits: Route
    fit_to_mean: Route
    difference: Difference


BY_KIND = {
    "allOf": [
        {
            "if": {"properties": {"kind": {"const": "two_stimuli"}}},
            "then": {"required": ["frequency", "estimators"]},
        },
        {"if": {"properties": {"kind": {"const": "population"}}}, "then": {"required": ["rows"]}},
    ]
}


@further(BY_KIND)
class Alternative(TypedDict):
    """An alternative to the paper's method. Result of an example under pipelines/examples, which the report of a study
    can show. Percent is of the true value or magnitude."""

    schema: Literal["mcstudy:alternative:1.0.0"]
    kind: Literal["two_stimuli", "population"]
    command: Annotated[str, Field(min_length=1, max_length=500)]
    """command that made this file"""
    settings: Annotated[dict[str, float | str], Field(max_length=30)]
    """settings by name with unit"""
    frequency: NotRequired[Numbers]
    estimators: NotRequired[Annotated[list[Estimator], Field(min_length=1, max_length=20)]]
    rows: NotRequired[Annotated[list[Row], Field(min_length=1, max_length=100)]]
