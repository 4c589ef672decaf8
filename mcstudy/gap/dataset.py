"""A diagnosis as labelled arrays."""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.verdict import effects_of, verdict


def dataset(d: DiagnosisRecord) -> xr.Dataset:
    """Lines, responses, residuals, causes with probability and likeness, and the torque that the nearest one leaves.

    Of that torque there is nothing where there is no nearest mechanism.
    """
    model = d.base.model
    units = " or ".join(dict.fromkeys(model.output_units))
    per = f"{units} per {'unit of the stimulus' if model.blocks else model.stimulus_unit}"
    line, both = "line", ("line", "angle")
    out = xr.Dataset(
        {
            "measured": (both, d.lines.y, {"units": per}),
            "base": (both, d.base.response(d.f), {"units": per}),
            "z": (both, d.detection.z, {"units": "1", "long_name": "standardised residual of the base model"}),
            "probability": ("cause", np.array([c.probability for c in d.causes]), {"units": "1"}),
            "likeness": (
                ("cause", "quantile"),
                np.array(
                    [
                        (np.nan,) * 3 if c.likeness is None else (c.likeness.low, c.likeness.estimate, c.likeness.high)
                        for c in d.causes
                    ]
                ).reshape(-1, 3),
                {"units": "1", "long_name": "share of the gap predicted at left-out lines"},
            ),
        },
        {
            "frequency": (line, d.f, {"units": "Hz"}),
            "angle": list(model.output_names),
            "cause": [effects_of(c) for c in d.causes],
            "quantile": [0.025, 0.5, 0.975],
        },
        {"name": d.name, "verdict": verdict(d), "p_value": d.p_value, "outside_the_library": d.unknown_probability}
        | {f"prior_{name}": p for name, p in d.prior.items()}
        | {"none_log_bayes_factor": d.none_log_factor},
    )
    if d.nearest is None:
        return out
    left, shape = d.nearest.remaining, ("quantile", "line")
    out["nearest"] = both, d.nearest.cause.fitted.response(d.f), {"units": per}
    about = {"long_name": f"torque at the {left.row} by {left.sense}, left by {' and '.join(d.nearest.effects)}"}
    gain, phase = np.array([left.gain_low, left.gain, left.gain_high]), [left.phase_low, left.phase, left.phase_high]
    out["torque_gain"] = shape, gain, {"units": left.unit, **about}
    out["torque_phase"] = shape, np.array(phase), {"units": "deg", **about}
    out["torque_gain"].attrs["probability"] = left.probability
    return out
