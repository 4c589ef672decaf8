"""Bodies that fall: a closed loop whose true parameters are unstable has no steady response, so no FRF to measure.

Such a study is refused before anything of it is run, unless it is asked for; then everything that shows it says so.
"""

from __future__ import annotations

import math

from mcstudy.errors import DesignError
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import growth_rate
from mcstudy.study.design import Study
from mcstudy.study.models import build_model


def instability(model: Model) -> str:
    """In words, how fast a body with the true parameters falls; empty for one that stands."""
    growth = float(growth_rate(model, model.truth))
    if growth < 0:
        return ""
    return f"growth rate {growth:+.3g} 1/s" if math.isfinite(growth) else "growth rate unknown"


def warning(what: str) -> str:
    """What is said of a group that falls; ``what`` is its `instability`."""
    return f"the closed loop of the true parameters is unstable ({what}), so its responses cannot be measured"


def warnings_of(study: Study) -> list[str]:
    """One line for every group that falls."""
    found = {name: instability(build_model(group)) for name, group in study.group.items()}
    return [f"group {name}: {warning(what)}" for name, what in found.items() if what]


def refuse_unstable(study: Study, allow: bool = False) -> None:
    """Raise `DesignError`, one line with group and growth rate, for the first group that falls.

    ``allow``: unless it is computed in the frequency domain, where a response exists that nobody could measure. In time
    it grows out of all numbers.
    """
    for name, group in study.group.items():
        refuse_unstable_model(build_model(group), group.simulator, allow, f"group.{name}.")


def refuse_unstable_model(model: Model, simulator: str, allow: bool, where: str = "") -> None:
    """The same for one model, the truth of which stands at ``where``."""
    in_time = simulator == "time_domain"
    if (not allow or in_time) and (what := instability(model)):
        remedy = (
            "a body that falls cannot be simulated in time; simulator 'spectral' can"
            if in_time
            else "--allow-unstable, in Python allow_unstable=True, accepts it"
        )
        raise DesignError(f"{where}model.truth: expected a stable closed loop, got an unstable one, {what} ({remedy})")
