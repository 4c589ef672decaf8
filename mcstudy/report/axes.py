"""What all figures share: making axes, colours, labelling logarithmic axes. Nothing here reads a study."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter, LogLocator, NullFormatter

from mcstudy.report.style import SERIES, SETTINGS

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


_SCALED = ("size", "linewidth")
"""Last words of the settings of text and lines."""


@contextmanager
def styled(scale: float = 1.0) -> Iterator[None]:
    """The report's settings while axes are made; ``scale``: size of text and lines against the page's."""
    scaled = {key: value * scale for key, value in SETTINGS.items() if key.endswith(_SCALED)}
    with matplotlib.rc_context({**SETTINGS, **scaled}):
        yield


def axes(ax: Axes | None, size: tuple[float, float] = (4.3, 3.2)) -> Axes:
    """``ax``, or new axes that a notebook shows."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt  # only here: it chooses a window system

    # Outside of the settings: the first figure of a notebook's kernel makes the kernel show figures, which is a setting
    # too, and would be undone with ours.
    figure = plt.figure(figsize=size, layout="constrained", facecolor=SETTINGS["figure.facecolor"])
    with styled():
        new: Axes = figure.add_subplot()
        return new


def picture(
    drawings: Sequence[Callable[[Axes], object]],
    title: str,
    columns: int | None = None,
    size: tuple[float, float] = (4.6, 4.4),
    scale: float = 1.0,
) -> Figure:
    """Drawings of ``size`` (inches) in rows of ``columns``, all in one by default, as a file of their own.

    ``scale``: size of text and lines against the page's.
    """
    columns = columns or max(len(drawings), 1)
    rows = max(-(-len(drawings) // columns), 1)
    with styled(scale):
        figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
        for ax, drawing in zip_longest(figure.subplots(rows, columns, squeeze=False).flat, drawings):
            (drawing or Axes.set_axis_off)(ax)
        figure.suptitle(title, fontsize="medium")
    return figure


def colour_of(values: np.ndarray, value: float) -> str:
    """Colour of one coordinate value of an axis."""
    return SERIES[int(np.argmin(np.abs(values - value))) % len(SERIES)]


def power_of_ten(value: float) -> str:
    """``10⁻³`` for 0.001; plain text, so that no font is needed for it."""
    return "10" + str(round(np.log10(value))).translate(_SUPERSCRIPT) if value > 0 else "0"


def log_axis(axis: Any, most: int = 7) -> None:
    """A logarithmic axis for what is drawn already: labelled at powers of ten, or at 1, 2, 5 where it spans few."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    low, high = axis.get_view_interval()
    if high / low < 150 and low >= 1e-4 and high < 1e5:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    else:
        axis.set_major_locator(LogLocator(numticks=most))
        axis.set_major_formatter(FuncFormatter(lambda v, _: power_of_ten(v)))
    axis.set_minor_formatter(NullFormatter())


def plain_log_axis(axis: Any, ticks: Sequence[float]) -> None:
    """A logarithmic axis with these ticks, written out."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    fixed_ticks(axis, ticks, [f"{t:g}" for t in ticks])
    axis.set_minor_formatter(NullFormatter())


def fixed_ticks(axis: Any, ticks: Iterable[float], labels: Sequence[str]) -> None:
    """Ticks with these labels; `Axis.set_ticks` would make five artists of each before anything is drawn."""
    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(FixedFormatter(list(labels)))


def frequency_axis(ax: Axes, f: np.ndarray) -> None:
    """Frequencies on a logarithmic x axis."""
    plain_log_axis(ax.xaxis, [t for t in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0) if f.min() * 0.8 <= t <= f.max() * 1.2])
    ax.set_xlabel("frequency (Hz)")


def legend_below(ax: Axes, columns: int = 3, lift: float = -0.16) -> None:
    """A legend under the axis label, where it covers nothing."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, lift), ncols=columns)
