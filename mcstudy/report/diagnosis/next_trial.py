"""Which trial to record next, as a section of the page of a diagnosis and as a picture of its own."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.patches import Patch

from mcstudy.gap.trial_planning.next_trial import NextTrialRecord
from mcstudy.gap.trial_planning.recommendation import HEADER, described, rows, sentence, twin_sentence
from mcstudy.gap.trial_planning.twins import Twins
from mcstudy.report.axes import axes
from mcstudy.report.figure import Figure, Panel
from mcstudy.report.style import COLOURS
from mcstudy.text_tables import Table

STEPS = (0.5, 0.8, 0.95)
"""Limits of the shades of \\|cosine\\|; effects above the last one are twins."""

SHADES = (0.08, 0.3, 0.55, 1.0)


def twin_map(before: Twins, after: Twins, ax: Axes | None = None) -> Axes:
    """Similarity of all effects: below the diagonal in what was recorded, above it with the recommended trial.

    Columns have the numbers of the rows; names would not fit beside each other.
    """
    ax = axes(ax, (8.8, 6.4))
    names = before.effects
    row, column = np.indices(before.cosine.shape)
    similar = np.where(row > column, before.cosine, after.cosine)
    shade = np.searchsorted(STEPS, similar, side="right")
    for step, alpha in enumerate(SHADES):
        y, x = np.nonzero((shade == step) & (row != column))
        ax.barh(y, 0.9, 0.9, left=x - 0.45, color=COLOURS["blue"], alpha=alpha, linewidth=0)
    ax.plot([-0.5, len(names) - 0.5], [-0.5, len(names) - 0.5], color=COLOURS["muted"], linewidth=0.8)
    ax.set_xticks(range(len(names)), [str(k + 1) for k in range(len(names))])
    ax.set_yticks(range(len(names)), [f"{name}  {k + 1}" for k, name in enumerate(names)])
    ax.set_xlim(-0.5, 1.2 * len(names))  # room for the legend
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines["bottom"].set_bounds(-0.5, len(names) - 0.5)
    ax.grid(visible=False)
    texts = [f"< {STEPS[0]:g}", *(f"> {s:g}" for s in STEPS)]
    keys = [Patch(facecolor=COLOURS["blue"], alpha=a, label=t) for a, t in zip(SHADES, texts, strict=True)]
    ax.legend(handles=keys, title="|cosine|", loc="center right")
    return ax


def next_figure(trial: NextTrialRecord) -> Figure:
    """The section of the page: the map before and after, and the table of trials."""
    return Figure(
        "twins",
        "Effects that look alike, before and with the recommended trial",
        [
            f"Recommended: {sentence(trial, trial.best)}. {twin_sentence(trial)}",
            "A square is darker the more alike two effects are (|cosine| of the residuals that they would leave): "
            "below the diagonal in what was recorded, above it with the recommended trial beside it. The darkest pairs "
            "cannot be told apart. Columns have the numbers of the rows.",
        ],
        [Panel("effects that look alike", partial(twin_map, trial.before, trial.after), (8.8, 6.4))],
        [Table("Possible trials", HEADER, rows(trial), kind="wide")],
    )


def twin_picture(trial: NextTrialRecord) -> Picture:
    """The map alone, on a new figure."""
    picture = Picture(figsize=(8.8, 6.8), layout="constrained")
    ax = picture.subplots()
    twin_map(trial.before, trial.after, ax)
    ax.set_title(f"Below: {trial.name}. Above: with\n{described(trial.best.plan)}", fontsize="medium")
    return picture
