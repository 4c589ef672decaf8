"""A diagnosis as a JSON document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from mcstudy.files import schema
from mcstudy.files.json_files import plain
from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.gap.questions.closure import Closure
from mcstudy.gap.questions.contrasts import Contrast
from mcstudy.gap.questions.detection import Band
from mcstudy.gap.questions.evidence import SizeEstimate
from mcstudy.gap.questions.nearest import SHOWN, Nearest
from mcstudy.gap.questions.posterior import Cause
from mcstudy.gap.questions.power import DetectionLimits
from mcstudy.gap.verdict import verdict
from mcstudy.lines.part_fits import parts_dict
from mcstudy.recordings.joint_recording import part_labels
from mcstudy.stance.body import standing


def document(d: DiagnosisRecord) -> dict[str, Any]:
    """All results as plain JSON data, valid under ``results_schema/1.1.0/diagnosis.json``."""
    tested, names = d.detection, d.base.model.output_names
    by_name = dict(zip(names, np.abs(tested.z).T, strict=True))
    answers = {a.name: a.to_dict() for a in d.answers}
    return plain(
        {
            "schema": schema.identifier("diagnosis"),
            "name": d.name,
            "verdict": verdict(d),
            "detected": d.detected,
            "p_value": d.p_value,
            "place": d.place,
            "place_abstained": d.place_abstained,
            "causes": [_cause(c) for c in d.causes if c.probability > SHOWN or c is d.causes[0]],
            "nearest": d.nearest and _nearest(d.nearest),
            "none_probability": d.none_probability,
            "unknown_probability": d.unknown_probability,
            "prior": d.prior,
            "none_log_bayes_factor": d.none_log_factor,
            "credible_set": [
                {"cause": k} if isinstance(k, str) else {"cause": "named", "effects": d.causes[k].effects}
                for k in d.credible_set
            ],
            "closed": d.closed and _closed(d.closed),
            "sway_rms_deg": d.sway_rms_deg,
            "sway_noise_deg": d.sway_noise_deg,
            "undetectable": answers.pop(DetectionLimits.name, []),
            "fit": {
                "chi2": tested.chi2,
                "expected": tested.expected_chi2,
                "p_value": tested.fit_p_value,
                "lines": len(d.f),
                "noise": tested.chi2_noise,
                "added_chi2": None if d.added is None else d.added.chi2,
            },
            "evidence": {"log_factor": tested.statistic, "limit": tested.statistic_limit, "p_value": tested.p_value},
            "bands": _bands(tested.bands),
            "z_map": {
                "f": d.f,
                **(by_name if standing(d.base.model) else {"outputs": by_name}),
                "limit": tested.z_limit,
            },
            "contrasts": [_contrast(c) for c in d.contrasts],
            "parameters": [asdict(shift) for shift in d.shifts],
            "groups": d.groups,
            "warnings": d.warnings,
            "method": d.method.to_dict(),
            **parts_dict(part_labels(d.recording, len(tested.parts)), tested.parts),
            **({"answers": answers} if answers else {}),
        }
    )


def _cause(c: Cause) -> dict[str, Any]:
    return {
        "effects": c.effects,
        "alternatives": c.alternatives,
        "probability": c.probability,
        "size": {size.name: _size(size) for size in c.sizes},
        **({"advice": c.advice} if c.advice else {}),
        "likeness": c.likeness and asdict(c.likeness),
    }


def _size(size: SizeEstimate) -> dict[str, Any]:
    return {"estimate": size.estimate, "se": size.se, "low": size.low, "high": size.high, "unit": size.unit}


def _nearest(near: Nearest) -> dict[str, Any]:
    """The nearest mechanism and what it leaves."""
    return {
        "effects": near.cause.effects,
        "alternatives": near.cause.alternatives,
        "probability": near.cause.probability,
        "likeness": near.cause.likeness and asdict(near.cause.likeness),
        "chi2": near.chi2,
        "bands": _bands(near.bands),
        "remaining": asdict(near.remaining),
    }


def _bands(bands: tuple[Band, ...]) -> list[dict[str, Any]]:
    return [{**asdict(band), "beyond": band.beyond} for band in bands]


def _closed(closed: Closure) -> dict[str, Any]:
    return {
        "fraction": closed.fraction,
        "low": closed.low,
        "high": closed.high,
        "at_noise_floor": closed.at_noise_floor,
        "energy_before": closed.before,
        "energy_after": closed.after,
        "trials_needed": closed.trials_needed,
    }


def _contrast(c: Contrast) -> dict[str, Any]:
    changes = [{"effect": k.effect, "gain": k.gain, "se": k.se, "z": k.z} for k in c.changes]
    return {"kind": c.kind, "between": c.between, "p_value": c.p_value, "changes": changes}
