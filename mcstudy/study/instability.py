"""Unstable bodies: if the closed loop is unstable at the true parameters, there is no steady response and no FRF.

Such a study is refused before it is run, unless the user allows it; then every table and page shows a warning.
"""

from __future__ import annotations

import math

from mcstudy.errors import DesignError
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate
from mcstudy.study.design import Study
from mcstudy.study.models import simulated_model


def instability(model: Model) -> str:
    """Growth rate of a body that is unstable at the true parameters, as text; empty for a stable one."""
    growth = float(growth_rate(model, model.truth))
    if growth < 0:
        return ""
    return f"growth rate {growth:+.3g} 1/s" if math.isfinite(growth) else "growth rate unknown"


def warning(what: str) -> str:
    """The warning for an unstable group; ``what`` is its `instability`."""
    return f"the closed loop of the true parameters is unstable ({what}), so its responses cannot be measured"


def warnings_of(study: Study) -> list[str]:
    """One line per unstable group."""
    instabilities = {name: instability(simulated_model(group)) for name, group in study.groups.items()}
    return [f"group {name}: {warning(what)}" for name, what in instabilities.items() if what]


def refuse_unstable(study: Study, allow: bool = False) -> None:
    """Raise `DesignError`, one line with group and growth rate, for the first unstable group.

    ``allow``: accept groups that are computed in the frequency domain. There a formal response exists, although it
    cannot be measured. A time simulation would overflow.
    """
    if not study.groups:
        raise DesignError("group: expected at least one, as Study.group(name, realizations=..., ...) adds it")
    for name, group in study.groups.items():
        field = "effects.truth" if group.effects.truth else "model.truth"
        refuse_unstable_model(simulated_model(group), group.simulator, allow, f"group.{name}.{field}")


def refuse_unstable_model(model: Model, simulator: str, allow: bool, field: str = "model.truth") -> None:
    """The same for one model; ``field`` is the one of its true values in the message."""
    in_time = simulator == "time_domain"
    if (not allow or in_time) and (what := instability(model)):
        remedy = (
            "an unstable body cannot be simulated in time; use simulator 'spectral'"
            if in_time
            else "to accept it: --allow-unstable, in Python allow_unstable=True"
        )
        raise DesignError(f"{field}: expected a stable closed loop, got an unstable one, {what} ({remedy})")
