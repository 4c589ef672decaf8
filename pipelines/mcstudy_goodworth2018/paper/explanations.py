"""Why a row differs from the paper, where something is known about it.

A note appears only if its claim holds for the study shown: it is computed from it, or it was measured in a shipped
study with the paper's settings and the stand-in truth, is marked so with its command, and the group shown has the same
settings and truth.
"""

from __future__ import annotations

from collections.abc import Callable

from mcstudy.analysis.view import GroupView
from mcstudy.stance.provenance import another_body
from mcstudy.stance.truths import INFERRED
from mcstudy_goodworth2018.paper.published import AMPLITUDES_NM

OFTEN_PERCENT = 50.0
"""Share of fits on a bound from which the bounds are said to determine a parameter's spread."""

MEASURED = "Measured with the settings of this group: "
"""In front of numbers that come from another study, which is named with its command."""

_STARTS = (
    "the number of starts depends on how the curve is read more than on the solver. An emulation of the paper's solver "
    "with its stated resolution reaches the published accuracy without noise (mean error 0.0077 %, paper 0.008 %) and "
    "needs 4 starts at 5 N m at a tolerance of 1 %, 14 at 0.001 % and 37 at 0.0001 %; lm needs 5, 15 and 19 (mcstudy "
    "run pipelines/paper_solver.toml; python pipelines/validation/paper_solver.py)."
)
_MORE_TORQUE = (
    "fifty times the torque, 150 instead of 3 N m, lowers the spread at 0.41 Hz by only 44 % (48.5 ± 1.6 to 27.2 ± "
    "1.1 %; mcstudy run pipelines/low_frequency.toml)."
)
_LOW_FREQUENCY_BIAS = (
    "the bias at 0.41 Hz shrinks when noise matters less, from 20.3 ± 2.4 % (mean of 12) at 3 N m to 7.1 ± 2.7 % at "
    "50 N m (mcstudy run pipelines/low_frequency.toml). Lower bounds at half the truth instead of zero reduce it by "
    "5.2 ± 1.1 % (mcstudy run pipelines/lower_bound_half.toml)."
)
_WIDTH = (
    "the bias at 8 Hz depends on the number of lines averaged into a point, which the paper does not state. The mean "
    "bias of 12 (10) parameters is 9.8 ± 1.1 (8.7 ± 1.0) % with all lines, as here; 15.8 ± 0.8 (5.2 ± 0.4) % with half "
    "of them; 14.7 ± 0.9 (8.5 ± 0.7) % with a quarter; 13.1 ± 1.0 (12.0 ± 1.3) % with one or two per point (mcstudy "
    "run pipelines/averaging_width.toml)."
)

Reason = Callable[[GroupView], str]


def has_shipped_setting(view: GroupView) -> bool:
    """Whether the group has the settings and the true values of the shipped studies (the defaults)."""
    return not view.differences


def _measured(text: str) -> Reason:
    return lambda view: MEASURED + text if has_shipped_setting(view) else ""


def _on_bounds(fmax: float) -> Reason:
    """The parameters that mostly end on a bound at an Fmax, if there are any."""

    def reason(view: GroupView) -> str:
        share = _percent_on_bound(view, fmax)
        often = {name: x for name, x in share.items() if x > OFTEN_PERCENT}
        if not often:
            return ""
        low, high = min(often.values()), max(often.values())
        how = f"{high:.0f}" if round(low) == round(high) else f"{low:.0f} to {high:.0f}"
        return (
            f"In this study, at {fmax:g} Hz, {', '.join(often)} end{'s' if len(often) == 1 else ''} on a bound in "
            f"{how} % of best fits, so the bounds limit the spread and push the estimates to one side."
        )

    return reason


def _percent_on_bound(view: GroupView, fmax: float) -> dict[str, float]:
    if view.fmax(fmax) is None or "at_bound" not in view.cells:
        return {}
    cells = view.at(view.cells[["at_bound", "cost"]], [fmax], AMPLITUDES_NM)
    used = cells["cost"].notnull()
    on = 100 * ((cells["at_bound"] != 0) & used).sum(["amplitude", "fmax", "realization"]) / max(int(used.sum()), 1)
    return {str(name): float(x) for name, x in zip(on["parameter"].values, on.values, strict=True)}


def _trade_off(view: GroupView) -> str:
    """K22 takes up the scatter of Kpas2, if it does: equal spread, and a sum that scatters much less."""
    if view.fmax(1.2) is None or view.combined is None:
        return ""

    def sd(cells: str, name: str) -> float:
        x = view.at(getattr(view, cells)[["estimate"]].sel(parameter=name), [1.2], AMPLITUDES_NM)["estimate"]
        return float(x.std("realization", ddof=1).mean())

    active, passive, total = sd("cells", "K22"), sd("cells", "Kpas2"), sd("combined", "K22+Kpas2")
    if not (0.7 < active / passive < 1.4 and total < 0.6 * active):
        return ""
    return (
        f"In this study K22 takes up the scatter of Kpas2: their SD is {active:.0f} and {passive:.0f} N m/rad, that of "
        f"their sum {total:.0f}. The rank of K22 therefore follows from the ratio of the true Kpas2 and K22."
    )


def _from_truth(_: GroupView) -> str:
    return "This follows from the true values alone, without any fit or Monte Carlo error."


def _origin(view: GroupView) -> str:
    """Where the true values come from; the paper's Table I is lost."""
    if INFERRED in view.provenance and not another_body(view.provenance):
        return (
            f"True values are {INFERRED}, this one among them where the inference uses it: an inference about the lost "
            "Table I (pipelines/table_one.md)."
        )
    if "stand-in" in view.provenance and not another_body(view.provenance):
        return "True values are a stand-in for the lost Table I and were not calibrated to this number."
    return "The paper's true values (Table I) are lost; those of this study are its own."


_LOW = 0.41
_BIAS_LOW = (_on_bounds(_LOW), _measured(_LOW_FREQUENCY_BIAS))
_SPREAD_LOW = (_on_bounds(_LOW), _measured(_MORE_TORQUE))
_MODEL = (_from_truth,)

_REASONS: dict[str, tuple[Reason, ...]] = {
    **{f"bias_{n}_0.41": _BIAS_LOW for n in (12, 10, 2)},
    **{f"bias_below_5_{n}_0.41": _BIAS_LOW for n in (12, 10)},
    **{f"bias_{n}_8": (_measured(_WIDTH),) for n in (12, 10)},
    "bias_8_largest": (_on_bounds(_LOW), _measured(_WIDTH)),
    **{f"spread_{kind}_0.41": _SPREAD_LOW for kind in ("amplitude", "amplitude_cv")},
    **dict.fromkeys(("spread_fmax", "spread_fmax_cv", "spread_fmax_10", "spread_fmax_2"), _SPREAD_LOW),
    **dict.fromkeys(("lowest_cv", "low_cv", "cv_stiffness_damping_each"), (_trade_off,)),
    **{f"starts_{what}": (_measured(_STARTS),) for what in ("noise_free", "5", "3")},
    **dict.fromkeys(("least_influential", "delays_low", "delays_high", "delays_most_high"), _MODEL),
    **dict.fromkeys(("stiffness_low", "damping_high", "sway_1", "sway_1_cycle", "sway_2", "sway_2_cycle"), _MODEL),
}


def explain_row(key: str, view: GroupView) -> str:
    """What is known about the difference of row ``key``, whose value is from the group ``view``."""
    said = [reason(view) for reason in _REASONS.get(key, ())]
    return " ".join([*filter(None, said), _origin(view)])
