"""Measures against the design as a picture, with their limits, the crossing and its interval."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from mcstudy.planning.arm import Arm
from mcstudy.planning.fits import Design
from mcstudy.planning.local_model import QUANTILE
from mcstudy.planning.next_look import leading
from mcstudy.planning.solution import SolutionRecord
from mcstudy.planning.space import CYCLES
from mcstudy.report.style import COLOURS
from mcstudy.report.svg_document import svg_document

WIDTH, HEIGHT, LEFT, TOP, GAP = 360.0, 250.0, 60.0, 58.0, 84.0
AXIS, LINE, LIMIT = (COLOURS[name] for name in ("muted", "orange", "blue"))
POINTS = 81


def solution_svg(found: SolutionRecord) -> str:
    """One panel for every target as an SVG document: the local model with its 95 % band along the leading axis.

    Points are designs that were fitted, with two standard errors. Those with other values on the other axes are left
    out. Without a leading axis, or without a target that depends on the design, the picture says so.
    """
    arm, axis = found.arm, leading(found.space)
    name = f"{found.study.study.name}. Blue line: target. Blue band: 95 % interval of the crossing."
    if arm is None or axis is None:
        body = [f'<text x="{LEFT:g}" y="{TOP + 20:g}">No axis along which a measure could be drawn.</text>']
        return svg_document("Measures against the design", name, (LEFT + WIDTH + 20, TOP + 60), LEFT, body)
    panels = [_panel(found, arm, axis, k, LEFT + k * (WIDTH + GAP)) for k in range(len(arm.targets))]
    size = (LEFT + len(panels) * (WIDTH + GAP) - GAP + 24, TOP + HEIGHT + 56)
    return svg_document("Measures against the design", name, size, LEFT, [line for panel in panels for line in panel])


@dataclass(frozen=True)
class Curve:
    """A measure along an axis, in its target's unit, with the others as in the answer.

    Attributes
    ----------
    values: of the axis, (n,). curves: lower end, middle and upper end of the local model's 95 % band, (3, n).
    looks: fitted designs on the axis: its value, the measure, one standard error.
    """

    values: np.ndarray
    curves: np.ndarray
    looks: list[tuple[float, float, float]]


def curve_of(found: SolutionRecord, arm: Arm, axis: str, k: int) -> Curve:
    """The measure of target ``k`` along ``axis``."""
    target, d = arm.targets[k], found.nearest
    low, high = map(float, found.space.cycles if axis == CYCLES else found.space.amplitude)
    values = np.geomspace(low, high, POINTS)
    cycles = values if axis == CYCLES else np.full(POINTS, float(d.cycles))
    amplitude = np.full(POINTS, d.amplitude) if axis == CYCLES else values
    band = arm.bands(cycles, amplitude)[k]
    ends = np.stack([band.value + side * QUANTILE * band.error for side in (-1, 0, 1)])
    curves = (ends if target.measure.signed else np.exp(ends)) * target.limit
    looks = [
        (at, look.found[k].value * target.limit, look.found[k].error * target.limit)
        for look in arm.looks
        if (at := _along(look.design.cycles, look.design.amplitude, axis, d)) is not None
    ]
    return Curve(values, curves, looks)


def _panel(found: SolutionRecord, arm: Arm, axis: str, k: int, x: float) -> list[str]:
    target, curve = arm.targets[k], curve_of(found, arm, axis, k)
    values, curves, looks = curve.values, curve.curves, curve.looks
    low, high = float(values[0]), float(values[-1])
    every = np.concatenate([curves.ravel(), [target.limit], [v for _, v, _ in looks]])
    bottom, top = _limits(every, target.measure.signed)

    def across(value: float) -> float:
        return x + float(np.log(value / low) / np.log(high / low)) * WIDTH

    def up(value: float) -> float:
        share = (
            (value - bottom) / (top - bottom)
            if target.measure.signed
            else np.log(max(value, bottom) / bottom) / np.log(top / bottom)
        )
        return TOP + HEIGHT - float(np.clip(share, 0, 1)) * HEIGHT

    out = [f'<text x="{x:g}" y="{TOP - 10:g}">{html.escape(target.name)} ({html.escape(target.unit)})</text>']
    for crossing in found.answer.crossings if found.answer else ():
        if crossing.axis == axis:
            left, right = across(crossing.low), across(crossing.high)
            out.append(
                f'<rect x="{left:.1f}" y="{TOP:g}" width="{max(right - left, 1):.1f}" height="{HEIGHT:g}" '
                f'fill="{LIMIT}" opacity="0.15"><title>{crossing.low:.4g} to {crossing.high:.4g}</title></rect>'
            )
    there = [f"{across(v):.1f} {up(c):.1f}" for v, c in zip(values, curves[2], strict=True)]
    back = [f"{across(v):.1f} {up(c):.1f}" for v, c in zip(values[::-1], curves[0][::-1], strict=True)]
    out.append(f'<path d="M{" L".join([*there, *back])}Z" fill="{LINE}" fill-opacity="0.25"/>')
    middle = [f"{across(v):.1f} {up(c):.1f}" for v, c in zip(values, curves[1], strict=True)]
    out.append(f'<path d="M{" L".join(middle)}" fill="none" stroke="{LINE}" stroke-width="1.6"/>')
    for limit in (target.limit, -target.limit) if target.measure.signed else (target.limit,):
        out.append(f'<path d="M{x:g} {up(limit):.1f}H{x + WIDTH:g}" stroke="{LIMIT}" stroke-dasharray="5 3"/>')
    for at, value, error in looks:
        out.append(
            f'<path d="M{across(at):.1f} {up(value - 2 * error):.1f}V{up(value + 2 * error):.1f}" stroke="{AXIS}"/>'
            f'<circle cx="{across(at):.1f}" cy="{up(value):.1f}" r="3" fill="{LINE}">'
            f"<title>{at:.4g}: {value:.3g} ± {error:.2g} {html.escape(target.unit)}</title></circle>"
        )
    out.append(f'<path d="M{x:g} {TOP:g}V{TOP + HEIGHT}H{x + WIDTH:g}" fill="none" stroke="{AXIS}"/>')
    for value in _ticks(bottom, top, target.measure.signed):
        out.append(f'<text x="{x - 6:g}" y="{up(value) + 3:.1f}" text-anchor="end">{value:.3g}</text>')
    for value in _ticks(low, high, linear=False):
        out.append(f'<text x="{across(value):.1f}" y="{TOP + HEIGHT + 14:g}" text-anchor="middle">{value:.3g}</text>')
    out.append(f'<text x="{x + WIDTH / 2:g}" y="{TOP + HEIGHT + 32:g}" text-anchor="middle">{axis}</text>')
    return out


def _along(cycles: int, amplitude: float, axis: str, at: Design) -> float | None:
    """Where a design lies on the axis; None where its other value is not that of the answer."""
    if axis == CYCLES:
        return float(cycles) if abs(amplitude / at.amplitude - 1) < 0.02 else None
    return amplitude if cycles == at.cycles else None


def _limits(values: np.ndarray, linear: bool) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    if linear:
        low, high = float(finite.min()), float(finite.max())
        margin = 0.08 * (high - low)
        return low - margin, high + margin
    return float(max(finite.min(), 1e-9) / 1.1), float(finite.max() * 1.1)


def _ticks(low: float, high: float, linear: bool) -> list[float]:
    """Five values from low to high, evenly spaced on the axis."""
    inner = np.linspace(low, high, 7)[1:-1] if linear else np.geomspace(low, high, 7)[1:-1]
    return [float(f"{v:.2g}") for v in inner]
