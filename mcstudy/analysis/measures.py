"""The quantities in which groups are compared: what a table says of them, without what computes them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """One compared quantity: its key, the header of its column, and its meaning; all are in percent."""

    key: str
    head: str
    meaning: str


MEASURES: dict[str, Measure] = {
    m.key: m
    for m in (
        Measure("bias", "|bias|", "mean |bias| of the parameters, % of the truth"),
        Measure("spread", "spread", "mean SD of the parameters, % of the truth"),
        Measure("rmse", "RMSE", "mean root mean squared error of the parameters, % of the truth"),
        Measure("unstable", "unstable", "best fits that are unstable, %"),
        Measure("on_bound", "on bound", "estimates that lie on a bound, %"),
        Measure("hits", "hit rate", "starts that reach the lowest cost of their cell, %"),
        Measure("frf_error", "FRF error", "mean distance of the mean FRF from the closed form, % of its magnitude"),
        Measure("frf_spread", "FRF spread", "mean SD of the FRF, % of its magnitude"),
    )
}
