"""Monte Carlo studies of identifiability, and diagnosis of the gap between model and body.

Studies: `Study` (or `read_study`), `plan`, `run`, `open_results`, `summary`; statistics are ``results["group"].mc``.
Recordings: `read_recording`, `import_recording`, `simulate`, `write_recording`; `fit` gives a person's parameters with
intervals, `fit_conditions` those in several conditions, `fit_group` those of many people; `diagnose` says what a model
lacks; `effects` are what it may lack.
`compare` says what differs between two groups of recordings or of frequency responses (`read_frf_group`).
"""

from __future__ import annotations

import mcstudy.program  # noqa: F401  # first of all: it notes the source that the others are loaded from

TYPE_CHECKING = False  # importing `typing` for it would take longer than all else until the command hears Ctrl-C
if TYPE_CHECKING:
    from typing import Any

    from mcstudy.analysis.results import open_results
    from mcstudy.api.compare import compare
    from mcstudy.api.conditions import fit_conditions
    from mcstudy.api.design import design
    from mcstudy.api.groups import fit_group, study_from
    from mcstudy.api.performance import performance
    from mcstudy.api.recordings import diagnose, fit, import_recording, next_trial
    from mcstudy.api.solve import solve
    from mcstudy.api.studies import plan, run, studies, summary, warm
    from mcstudy.effect_library.effect import Effect
    from mcstudy.effect_library.library import LIBRARY as effects
    from mcstudy.effect_library.simulation import simulate
    from mcstudy.errors import InputError, Interrupted
    from mcstudy.own_model import run_model
    from mcstudy.recordings.frf import FrfRecording
    from mcstudy.recordings.frf_group import read_frf_group
    from mcstudy.recordings.io import read_recording, write_recording
    from mcstudy.recordings.recording import Recording, Trial
    from mcstudy.recordings.soundness import fill_gaps
    from mcstudy.results.comparison import Comparison
    from mcstudy.results.conditions import ConditionsResult
    from mcstudy.results.diagnosis import Diagnosis
    from mcstudy.results.fit import FitResult
    from mcstudy.results.group_result import GroupResult
    from mcstudy.stance.body import Body
    from mcstudy.stance.feedback import Derived, Filter, Model, Output, OutputTerm, Parameter, Term
    from mcstudy.stance.linked_body import LinkedBody
    from mcstudy.study.design import Study
    from mcstudy.study.study_file import read_study

    __version__: str

_FROM = {
    "Body": "stance.body",
    "Comparison": "results.comparison",
    "ConditionsResult": "results.conditions",
    "Derived": "stance.feedback",
    "Diagnosis": "results.diagnosis",
    "Effect": "effect_library.effect",
    "Filter": "stance.feedback",
    "FitResult": "results.fit",
    "FrfRecording": "recordings.frf",
    "GroupResult": "results.group_result",
    "InputError": "errors",
    "Interrupted": "errors",
    "LinkedBody": "stance.linked_body",
    "Model": "stance.feedback",
    "Output": "stance.feedback",
    "OutputTerm": "stance.feedback",
    "Parameter": "stance.feedback",
    "Recording": "recordings.recording",
    "Study": "study.design",
    "Term": "stance.feedback",
    "Trial": "recordings.recording",
    "compare": "api.compare",
    "design": "api.design",
    "diagnose": "api.recordings",
    "effects": "effect_library.library:LIBRARY",
    "extend": "api.cubes",
    "fill_gaps": "recordings.soundness",
    "fit": "api.recordings",
    "fit_conditions": "api.conditions",
    "fit_group": "api.groups",
    "import_recording": "api.recordings",
    "next_trial": "api.recordings",
    "open_results": "analysis.results",
    "performance": "api.performance",
    "plan": "api.studies",
    "read_frf_group": "recordings.frf_group",
    "read_recording": "recordings.io",
    "read_study": "study.study_file",
    "replay": "api.cubes",
    "run": "api.studies",
    "run_model": "own_model",
    "run_until": "api.cubes",
    "simulate": "effect_library.simulation",
    "solve": "api.solve",
    "status": "api.cube_status",
    "studies": "api.studies",
    "study_from": "api.groups",
    "summary": "api.studies",
    "verify": "api.cubes",
    "warm": "api.studies",
    "write_recording": "recordings.io",
    "write_report": "api.cubes",
}
"""Where each name comes from, imported when it is asked for: help must not wait for xarray, Dask and numba."""

__all__ = [
    "Body",
    "Comparison",
    "ConditionsResult",
    "Derived",
    "Diagnosis",
    "Effect",
    "Filter",
    "FitResult",
    "FrfRecording",
    "GroupResult",
    "InputError",
    "Interrupted",
    "LinkedBody",
    "Model",
    "Output",
    "OutputTerm",
    "Parameter",
    "Recording",
    "Study",
    "Term",
    "Trial",
    "__version__",
    "compare",
    "design",
    "diagnose",
    "effects",
    "extend",
    "fill_gaps",
    "fit",
    "fit_conditions",
    "fit_group",
    "import_recording",
    "next_trial",
    "open_results",
    "performance",
    "plan",
    "read_frf_group",
    "read_recording",
    "read_study",
    "replay",
    "run",
    "run_model",
    "run_until",
    "simulate",
    "solve",
    "status",
    "studies",
    "study_from",
    "summary",
    "verify",
    "warm",
    "write_recording",
    "write_report",
]


def __dir__() -> list[str]:
    return [*__all__, "__doc__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("mcstudy")
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    module, _, attribute = _FROM[name].partition(":")
    value = getattr(importlib.import_module(f"mcstudy.{module}"), attribute or name)
    globals()[name] = value
    return value
