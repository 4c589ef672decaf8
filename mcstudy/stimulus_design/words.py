"""The tables of a stimulus design as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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

CRITERIA = {"D": "D-optimal", "A": "A-optimal", "c": "optimal for"}


def text(design: StimulusDesign) -> str:
    """What was designed, what it promises, and what the Monte Carlo study found."""
    parts = [_heading(design), _size(design), _parameters(design)]
    if design.spreads:
        parts += [_verified(design), *(_fits(design, s) for s in design.spreads)]
    if design.bodies:
        parts.append(_bodies(design))
    return "\n\n".join(parts)


def _heading(design: StimulusDesign) -> str:
    d, s = design.designed, design.designed.file.design
    kind = d.file.stimulus.kind.replace("_", " ")
    what = f"{CRITERIA[s.criterion]} {s.parameter}".strip()
    gain = np.exp(np.log(design.predicted_ratio).mean())
    kept = np.exp(np.log(design.bounded_cv[0] / design.bounded_cv[1]).mean())
    empty = f", {counted(int(d.empty.sum()), 'detection line')} empty" if d.empty.any() else ""
    largest = float((d.after / d.after.sum()).max())
    convention = d.stimulus.convention.replace("_", " ")
    return fill(
        f"{s.name}: {what} stimulus ({kind}), {counted(len(d.stimulus.harmonic), 'odd line')} up to {d.f[-1]:.3g} Hz"
        f"{empty}, {d.file.cycles} cycles of {d.stimulus.period_s:g} s, amplitude {d.stimulus.amplitude:.4g} "
        f"{d.model.stimulus_unit} ({convention}). Predicted: standard deviations lower by x{gain:.3g} (geometric "
        f"mean), x{kept:.3g} with the bounds of the fit. No allowed spectrum is better by more than "
        f"{50 * d.optimum.gap:.1g} % in the mean SD of the criterion. Largest line: {100 * largest:.0f} % of the power."
    )


def _size(design: StimulusDesign) -> str:
    """Sizes of both stimuli, and the limits."""
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
    limits = [f"{LIMITS[name]} {100 * np.sqrt(share):.0f} %" for name, share in sorted(design.designed.limits.items())]
    used = "Used of the limits (in amplitude; sway: of the body whose limit is nearest): " + ", ".join(limits) + "."
    return "\n".join([table(["", "sequence", "design", "ratio"], rows), "", fill(used)])


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


def _bodies(design: StimulusDesign) -> str:
    found = np.array([b.found.mean for b in design.bodies])
    error = np.array([b.found.mean_error for b in design.bodies])
    sway = np.array([b.sway for b in design.bodies])
    said = np.array([b.predicted for b in design.bodies])
    spread, n = 100 * design.designed.file.prior.spread, len(design.bodies)
    mean, which = np.exp(np.log(found).mean()), "other body" if n == 1 else "other bodies"
    return fill(
        f"{n} {which} drawn within ±{spread:g} %: standard deviations lower by "
        f"x{mean:.3g} (geometric mean over bodies; x{found.min():.3g} to x{found.max():.3g}, each ± about "
        f"{np.median(error):.2g}; predicted with bounds x{np.exp(np.log(said).mean()):.3g}); evoked sway at most "
        f"{sway.max():.3g} of the sequence's."
    )
