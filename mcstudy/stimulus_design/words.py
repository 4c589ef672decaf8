"""The tables of a stimulus design as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mcstudy.effect_library.library import effect
from mcstudy.stimulus_design.verify import Spread
from mcstudy.text_tables import counted, fill, number, table, with_error

if TYPE_CHECKING:
    from mcstudy.stimulus_design.result import StimulusDesign

LIMITS = {
    "limits.rms": "RMS of the stimulus",
    "limits.rate": "RMS of its rate of change",
    "limits.sway": "RMS of the evoked sway",
    "limits.crest_factor": "crest factor",
    "limits.peak": "peak of the stimulus",
}
"""Limits by their fields."""

CRITERIA = {"D": "D-optimal", "A": "A-optimal", "c": "optimal for", "difference": ""}

DISTANCES = "Distance of the responses from all that the model can give without the effect, in standard deviations"
DISTANCE_HEAD = ["effect", "size", "against", "sequence", "design", "ratio"]


def text(design: StimulusDesign) -> str:
    """What was designed, what it promises, and what the Monte Carlo study found."""
    parts = [fill(heading(design)), _size(design)]
    if design.distances.size:
        parts.append(f"{DISTANCES}\n{table(DISTANCE_HEAD, distance_rows(design))}")
    parts.append(_parameters(design))
    if design.spreads:
        parts += [_verified(design), *(_fits(design, s) for s in design.spreads)]
    parts.append(fill(sway_words(design)))
    if design.bodies:
        parts.append(fill(bodies_words(design)))
    return "\n\n".join(parts)


def heading(design: StimulusDesign) -> str:
    """What was designed and what it promises."""
    d, s = design.designed, design.designed.file.design
    kind = d.file.stimulus.kind.replace("_", " ")
    what = f"{CRITERIA[s.criterion]} {s.parameter}".strip() + f" stimulus ({kind})"
    gain = np.exp(np.log(design.predicted_ratio).mean())
    kept = np.exp(np.log(design.bounded_cv[0] / design.bounded_cv[1]).mean())
    empty = f", {counted(int(d.empty.sum()), 'detection line')} empty" if d.empty.any() else ""
    gained = "mean SD of the criterion"
    if s.effects:
        what, gained = f"stimulus ({kind}) optimal to {_purpose(s.effects)}", "distance of the models"
    largest = float((d.after / d.after.sum()).max())
    convention = d.stimulus.convention.replace("_", " ")
    return (
        f"{s.name}: {what}, {counted(len(d.stimulus.harmonic), 'odd line')} up to {d.f[-1]:.3g} Hz"
        f"{empty}, {d.file.cycles} cycles of {d.stimulus.period_s:g} s, amplitude {d.stimulus.amplitude:.4g} "
        f"{d.model.stimulus_unit} ({convention}). Predicted: standard deviations lower by x{gain:.3g} (geometric "
        f"mean), x{kept:.3g} with the bounds of the fit. No spectrum within the same limits is better by more than "
        f"{50 * d.optimum.gap:.1g} % in the {gained}. Largest line: {100 * largest:.0f} % of the power."
    )


def _purpose(effects: tuple[str, ...]) -> str:
    return f"show {effects[0]}" if len(effects) == 1 else f"tell {' from '.join(effects)}"


def distance_rows(design: StimulusDesign) -> list[list[str]]:
    """Every effect of the criterion "difference" with its size, what it is told from, and its distances."""
    shown = design.designed.difference
    if shown is None:
        return []
    rows = []
    for name, sizes, one, other in zip(shown.effects, shown.sizes, *design.distances, strict=True):
        units = {s.name: s.unit for s in effect(name).sizes}
        size = ", ".join(f"{key} = {number(sizes[key])} {unit}".strip() for key, unit in units.items())
        against = " and ".join(e for e in shown.effects if e != name) or "no missing effect"
        rows.append([name, size, against, number(one), number(other), f"x{other / one:.3g}"])
    return rows


def _size(design: StimulusDesign) -> str:
    """Sizes of both stimuli, and the limits."""
    rows = table(["", "sequence", "design", "ratio"], size_rows(design))
    return "\n".join([rows, "", fill(limits_used(design))])


def size_rows(design: StimulusDesign) -> list[list[str]]:
    """Sizes of sequence and design, and their ratio."""
    unit, (one, other) = design.designed.model.stimulus_unit, design.sizes
    rows = [
        [f"RMS of the stimulus ({unit})", number(one.rms), number(other.rms), number(other.rms / one.rms)],
        [f"peak ({unit})", number(one.peak), number(other.peak), number(other.peak / one.peak)],
        [f"RMS of its rate ({unit}/s)", number(one.rate), number(other.rate), number(other.rate / one.rate)],
        ["crest factor", number(one.crest_factor), number(other.crest_factor), "-"],
    ]
    for k, (a, b, noise) in enumerate(zip(one.sway, other.sway, design.noise_sway, strict=True)):
        total = np.hypot(b, noise) / np.hypot(a, noise)
        rows.append([f"RMS of evoked sway, theta{k + 1} (deg)", *(number(float(np.degrees(v))) for v in (a, b))])
        rows[-1].append(number(float(b / a)))
        rows.append([f"the same with the noise sway, theta{k + 1} (deg)"])
        rows[-1] += [number(float(np.degrees(np.hypot(v, noise)))) for v in (a, b)] + [number(float(total))]
    return rows


def limits_used(design: StimulusDesign) -> str:
    """How near every limit is."""
    limits = [f"{LIMITS[name]} {100 * np.sqrt(share):.0f} %" for name, share in sorted(design.designed.limits.items())]
    share = design.designed.file.limits.bodies_within
    other = f", or of the one in whom {100 * share:g} % of the bodies sway less" if share else ""
    return f"Used of the limits (in amplitude; sway: of the body of the file{other}): " + ", ".join(limits) + "."


def _parameters(design: StimulusDesign) -> str:
    """Predicted errors, and those that the bounds of the fit leave."""
    both = (*design.cv, *design.bounded_cv)
    rows = [
        [name, f"{100 * a:.3g} %", f"{100 * b:.3g} %", f"x{a / b:.3g}", f"{100 * c:.3g} %", f"{100 * d:.3g} %"]
        for name, a, b, c, d in zip(design.names, *both, strict=True)
    ]
    rows = [[*row, f"x{c / d:.3g}"] for row, c, d in zip(rows, *design.bounded_cv, strict=True)]
    mean = [np.exp(np.log(v).mean()) for v in both]
    rows.append(["geometric mean", f"{100 * mean[0]:.3g} %", f"{100 * mean[1]:.3g} %", f"x{mean[0] / mean[1]:.3g}"])
    rows[-1] += [f"{100 * mean[2]:.3g} %", f"{100 * mean[3]:.3g} %", f"x{mean[2] / mean[3]:.3g}"]
    head = ["predicted CV", "sequence", "design", "lower by", "sequence, bounds", "design, bounds", "lower by"]
    return table(head, rows)


def _verified(design: StimulusDesign) -> str:
    s = design.spreads_at_fmax
    return fill(
        f"Monte Carlo with bounded fits: standard deviations lower by x{with_error(s.mean, s.mean_error)} "
        f"(geometric mean, maximum likelihood, Fmax {s.fmax:g} Hz, {s.n} realizations)."
    )


def _fits(design: StimulusDesign, s: Spread) -> str:
    """Spread of the best fits of one cost and Fmax."""
    rows = [
        [
            name,
            f"{100 * s.cv[0, k]:.3g} %",
            f"{100 * s.cv[1, k]:.3g} %",
            f"x{with_error(s.ratio[k], s.ratio_error[k])}",
            f"{100 * s.bias[0, k]:.1f} %",
            f"{100 * s.bias[1, k]:.1f} %",
            f"{100 * s.at_bound[0, k]:.0f} %",
            f"{100 * s.at_bound[1, k]:.0f} %",
        ]
        for k, name in enumerate(design.names)
    ]
    mean = ["geometric mean", *(f"{100 * np.exp(np.log(cv).mean()):.3g} %" for cv in s.cv)]
    rows.append([*mean, f"x{with_error(s.mean, s.mean_error)}", "", "", "", ""])
    cost = "maximum likelihood on lines" if s.cost == "ml" else "the paper's cost on its points"
    title = f"CV of bounded fits, {cost}, Fmax {s.fmax:g} Hz, {counted(s.n, 'realization')} (± one MCSE)"
    head = ["", "sequence", "design", "lower by", "bias", "design", "on bound", "design"]
    return f"{title}\n{table(head, rows)}"


def sway_words(design: StimulusDesign) -> str:
    """How many bodies that nobody knew keep the limit of the sway."""
    o, limits = design.others, design.designed.file.limits
    asked = (
        f"{100 * limits.bodies_within:g} % of the bodies shall"
        if limits.bodies_within
        else "the body of the file shall"
    )
    return (
        f"Sway: {asked} sway at most {limits.sway:g} times as much as with the sequence. Of {o.drawn:,} other bodies "
        f"drawn within ±{100 * design.designed.file.prior.spread:g} %, {100 * o.within:.1f} % "
        f"[{100 * o.low:.1f}, {100 * o.high:.1f}] do: median {o.median:.3g}, 95th percentile {o.percentile_95:.3g}, "
        f"largest {o.largest:.3g} times."
    )


def bodies_words(design: StimulusDesign) -> str:
    """Bodies that the design did not know: predicted and found reduction of the errors."""
    file, n = design.designed.file, len(design.bodies)
    said = np.array([b.predicted for b in design.bodies])
    fits = [b.found for b in design.bodies if b.found is not None]
    which = "other body" if n == 1 else "other bodies"
    words = (
        f"{n} {which} drawn within ±{100 * file.prior.spread:g} %: predicted standard deviations with bounds lower by "
        f"x{_mean(said):.3g} (geometric mean over bodies; x{said.min():.3g} to x{said.max():.3g})."
    )
    if fits:
        found, error = np.array([s.mean for s in fits]), np.median([s.mean_error for s in fits])
        words += (
            f" Bounded fits: lower by x{_mean(found):.3g} (x{found.min():.3g} to x{found.max():.3g}, each ± about "
            f"{error:.2g})."
        )
    return words


def _mean(values: np.ndarray) -> float:
    return float(np.exp(np.log(values).mean()))
