"""The tables of a stimulus design as text."""

from __future__ import annotations

import numpy as np

from mcstudy.effect_library.library import effect
from mcstudy.recordings.units import as_shown
from mcstudy.stimulus_design.design_record import StimulusDesignRecord, geometric_mean
from mcstudy.stimulus_design.verify import Spread
from mcstudy.text_tables import Table, counted, fill, number, with_error

LIMITS = {
    "limits.rms": "RMS of the stimulus",
    "limits.rate": "RMS of its rate of change",
    "limits.sway": "RMS of the evoked sway",
    "limits.crest_factor": "crest factor",
    "limits.peak": "peak of the stimulus",
}
"""Limits by their fields."""

CRITERIA = {"D": "D-optimal", "A": "A-optimal", "c": "optimal for", "difference": ""}


def text(design: StimulusDesignRecord) -> str:
    """What was designed, what it promises, and what the Monte Carlo study found."""
    parts = [fill(heading(design)), sizes(design).text() + "\n\n" + fill(limits_used(design))]
    if design.distances.size:
        parts.append(distances(design).text(titled=True))
    parts.append(_parameters(design).text())
    if design.spreads:
        parts += [_verified(design), *(_fits(design, s).text(titled=True) for s in design.spreads)]
    parts.append(fill(sway_words(design)))
    if design.bodies:
        parts.append(fill(bodies_words(design)))
    return "\n\n".join(parts)


def percent(share: float) -> str:
    """A share in percent."""
    return f"{100 * share:.3g} %"


def compared(sequence: float, design: float, times: str = "x") -> list[str]:
    """A share with sequence and design, and by which factor it is lower."""
    return [percent(sequence), percent(design), f"{times}{sequence / design:.3g}"]


def heading(design: StimulusDesignRecord) -> str:
    """What was designed and what it promises."""
    d, s = design.designed, design.designed.file.design
    kind = d.model.name if d.file.model.declared else d.file.stimulus.kind.replace("_", " ")
    what = f"{CRITERIA[s.criterion]} {s.parameter}".strip() + f" stimulus ({kind})"
    gain = geometric_mean(design.predicted_ratio)
    kept = geometric_mean(design.bounded_cv[0] / design.bounded_cv[1])
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


def distances(design: StimulusDesignRecord) -> Table:
    """Every effect of the criterion "difference" with its size, what it is told from, and its distances."""
    title = "Distance of the responses from all that the model can give without the effect, in standard deviations"
    difference = design.designed.difference
    rows = []
    if difference is not None:
        for name, size, sequence, other in zip(difference.effects, difference.sizes, *design.distances, strict=True):
            units = {s.name: s.unit for s in effect(name).sizes}
            text = ", ".join(f"{key} = {number(size[key])} {unit}".strip() for key, unit in units.items())
            against = " and ".join(e for e in difference.effects if e != name) or "no missing effect"
            rows.append([name, text, against, number(sequence), number(other), f"x{other / sequence:.3g}"])
    return Table(title, ["effect", "size", "against", "sequence", "design", "ratio"], rows)


def sizes(design: StimulusDesignRecord) -> Table:
    """Sizes of sequence and design, and their ratio."""
    unit, (before, after) = design.designed.model.stimulus_unit, design.sizes
    values = [
        (f"RMS of the stimulus ({unit})", before.rms, after.rms),
        (f"peak ({unit})", before.peak, after.peak),
        (f"RMS of its rate ({unit}/s)", before.rate, after.rate),
    ]
    model = design.designed.model
    of_outputs = zip(model.output_names, model.output_units, before.sway, after.sway, design.noise_sway, strict=False)
    for name, own, *sway, noise in of_outputs:
        per, shown = as_shown(own)
        values.append((f"RMS of evoked sway, {name} ({shown})", *(per * np.array(sway)).tolist()))
        both = per * np.hypot(sway, noise)
        values.append((f"the same with the noise sway, {name} ({shown})", *both.tolist()))
    rows = [[name, number(a), number(b), number(b / a)] for name, a, b in values]
    rows.insert(3, ["crest factor", number(before.crest_factor), number(after.crest_factor), "-"])
    return Table("Sizes", ["", "sequence", "design", "ratio"], rows)


def limits_used(design: StimulusDesignRecord) -> str:
    """How near every limit is."""
    limits = [f"{LIMITS[name]} {100 * np.sqrt(share):.0f} %" for name, share in sorted(design.designed.limits.items())]
    share = design.designed.file.limits.bodies_within
    other = f", or of the one in whom {100 * share:g} % of the bodies sway less" if share else ""
    return f"Used of the limits (in amplitude; sway: of the body of the file{other}): " + ", ".join(limits) + "."


def _parameters(design: StimulusDesignRecord) -> Table:
    """Predicted errors, and those that the bounds of the fit leave."""
    pairs = [np.append(cv, geometric_mean(cv)).tolist() for cv in (*design.cv, *design.bounded_cv)]
    rows = [
        [name, *compared(before, after), *compared(bounded_before, bounded_after)]
        for name, before, after, bounded_before, bounded_after in zip(
            (*design.names, "geometric mean"), *pairs, strict=True
        )
    ]
    head = ["predicted CV", "sequence", "design", "lower by", "sequence, bounds", "design, bounds", "lower by"]
    return Table("Predicted errors", head, rows)


def _verified(design: StimulusDesignRecord) -> str:
    s = design.spreads_at_fmax
    return fill(
        f"Monte Carlo with bounded fits: standard deviations lower by x{with_error(s.mean, s.mean_error)} "
        f"(geometric mean, maximum likelihood, Fmax {s.fmax:g} Hz, {s.n} realizations)."
    )


def _fits(design: StimulusDesignRecord, s: Spread) -> Table:
    """Spread of the best fits of one cost and Fmax."""
    rows = [
        [
            name,
            *(percent(cv) for cv in s.cv[:, k]),
            f"x{with_error(s.ratio[k], s.ratio_error[k])}",
            *(f"{100 * bias:.1f} %" for bias in s.bias[:, k]),
            *(f"{100 * share:.0f} %" for share in s.at_bound[:, k]),
        ]
        for k, name in enumerate(design.names)
    ]
    mean = [percent(geometric_mean(cv)) for cv in s.cv]
    rows.append(["geometric mean", *mean, f"x{with_error(s.mean, s.mean_error)}", "", "", "", ""])
    cost = "maximum likelihood on lines" if s.cost == "ml" else "the paper's cost on its points"
    title = f"CV of bounded fits, {cost}, Fmax {s.fmax:g} Hz, {counted(s.n, 'realization')} (± one MCSE)"
    return Table(title, ["", "sequence", "design", "lower by", "bias", "design", "on bound", "design"], rows)


def sway_words(design: StimulusDesignRecord) -> str:
    """How many bodies that nobody knew keep the limit of the sway."""
    others, limits = design.others, design.designed.file.limits
    share = limits.bodies_within
    bodies = f"{100 * share:g} % of the bodies shall" if share else "the body of the file shall"
    return (
        f"Sway: {bodies} sway at most {limits.sway:g} times as much as with the sequence. Of {others.drawn:,} other "
        f"bodies drawn within ±{100 * design.designed.file.prior.spread:g} %, {100 * others.within:.1f} % "
        f"[{100 * others.low:.1f}, {100 * others.high:.1f}] do: median {others.median:.3g}, 95th percentile "
        f"{others.percentile_95:.3g}, largest {others.largest:.3g} times."
    )


def bodies_words(design: StimulusDesignRecord) -> str:
    """Bodies that the design did not know: predicted and found reduction of the errors."""
    spread, bodies = design.designed.file.prior.spread, "other body" if len(design.bodies) == 1 else "other bodies"
    lower = _reduction([b.predicted for b in design.bodies], "geometric mean over bodies; ")
    words = (
        f"{len(design.bodies)} {bodies} drawn within ±{100 * spread:g} %: predicted standard deviations with bounds "
        f"lower by {lower}."
    )
    fits = [b.found for b in design.bodies if b.found is not None]
    if not fits:
        return words
    error = f"{np.median([s.mean_error for s in fits]):.2g}"
    return f"{words} Bounded fits: lower by {_reduction([s.mean for s in fits], '', f', each ± about {error}')}."


def _reduction(ratios: list[float], before: str = "", after: str = "") -> str:
    """``x2.1 (x1.9 to x2.4)``."""
    return f"x{geometric_mean(np.array(ratios)):.3g} ({before}x{min(ratios):.3g} to x{max(ratios):.3g}{after})"
