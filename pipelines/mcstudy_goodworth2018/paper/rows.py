"""The rows *paper | ours | verdict*: the value of a study for each of `mcstudy_goodworth2018.paper.statements.RESULTS`.

A row exists only if the study has a group with the Fmax and amplitudes of the paper's number. The values are those of
`mcstudy_goodworth2018.paper.values`, `model_rows` and `search_rows`; here they get the groups they are about.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.publications.publication import Row
from mcstudy.analysis.publications.sampling import Value
from mcstudy.analysis.publications.verdict import judge
from mcstudy.analysis.publications.verdict_names import DIFFERS
from mcstudy.analysis.search.minimum_curve import minimum_curve
from mcstudy.analysis.view import GroupView, StudyView
from mcstudy_goodworth2018.paper import accuracy_rows, groups, published, search_rows
from mcstudy_goodworth2018.paper.explanations import explain_row
from mcstudy_goodworth2018.paper.model_rows import sensitivity_values, sway_values
from mcstudy_goodworth2018.paper.published import AMPLITUDES_NM, CONVERGENCE_FMAX_HZ, FMAX_HZ
from mcstudy_goodworth2018.paper.statements import RESULTS
from mcstudy_goodworth2018.paper.values import fit_values, relation_values

LEAST_POOL = 100
"""Starts of a pool from which Fig. 3B is drawn."""


def rows(study: StudyView) -> list[Row]:
    """All rows that this study can fill, by subject."""
    found = dict(_values(study))
    floors = _Floors(study)
    out = []
    for key, paper in RESULTS.items():
        if key not in found:
            continue
        ours, view = found[key]
        verdict = judge(paper, ours)
        note = explain_row(key, view) if verdict.name == DIFFERS else ""
        out.append(Row(paper, ours, view.name, verdict, floors.of(key), note))
    return out


def _values(study: StudyView) -> Iterator[tuple[str, tuple[Value, GroupView]]]:
    for values, view in (*_of_fits(study), *_of_models(study), *_of_searches(study)):
        for key, value in values.items():
            yield key, (value, view)


Found = Iterator[tuple[dict[str, Value], GroupView]]

_SETS = (FMAX_HZ, FMAX_HZ[:2], FMAX_HZ[1:], *((f,) for f in FMAX_HZ))
"""Sets of Fmax that a row may need together."""


def _needs(key: str) -> tuple[float, ...]:
    """The Fmax that a row of `fit_values` needs."""
    if key in accuracy_rows.SMOOTH:
        return accuracy_rows.SMOOTH[key][0]
    if key in accuracy_rows.COUNTED:
        return accuracy_rows.COUNTED[key][0]
    if key in ("bias_over_5", "low_cv_influential", "influence_cv", "influence_bias"):
        return (accuracy_rows.MID,)
    single = {f"unstable_{f:g}": (f,) for f in FMAX_HZ}
    return single.get(key, FMAX_HZ)


def _of_fits(study: StudyView) -> Found:
    """Each row from the group that is nearest to the paper's setting among those with the Fmax it needs."""
    computed: dict[str, dict[str, Value]] = {}
    for needed in _SETS:
        view = groups.accuracy(study, needed, AMPLITUDES_NM)
        if view is None:
            continue
        if view.name not in computed:
            computed[view.name] = _of_group(view)
        yield {k: v for k, v in computed[view.name].items() if _needs(k) == needed}, view


def _of_group(view: GroupView) -> dict[str, Value]:
    held = [f for f in FMAX_HZ if view.fmax(f) is not None]
    out = fit_values(view.at(view.cells, held, AMPLITUDES_NM), view.model)
    if view.group.starts > 2 and len(held) == len(FMAX_HZ):
        cube = view.at(view.cube, held, AMPLITUDES_NM)
        out |= relation_values(search_rows.relation_of_starts(cube, view.model))
    return out


def _of_models(study: StudyView) -> Found:
    view = groups.accuracy(study, [FMAX_HZ[-1]], [])
    if view is not None:
        yield sensitivity_values(view.model, view.cube["frequency"].values), view
        g = view.group
        s, noise = g.stimulus, g.noise_source
        period_s = (3**s.stages - 1) * s.state_s
        yield sway_values(view.model, noise, s.cycles * period_s, s.cycles, s.rate_hz), view


def _of_searches(study: StudyView) -> Found:
    view = groups.noise_free(study, FMAX_HZ[-1], published.STARTS)
    if view is not None:
        cube = view.cube[["estimate", "cost", "status", "truth"]].drop_vars("start")
        cube = cube.sel(fmax=view.fmax(FMAX_HZ[-1])).isel(amplitude=0).compute()
        cube = cube.assign_coords(frequency=view.cube["frequency"])
        yield search_rows.theory_values(cube, view.model), view
    view = groups.accuracy(study, [CONVERGENCE_FMAX_HZ], AMPLITUDES_NM)
    if view is not None and view.group.starts > 1:
        rate = view.needed["hit_rate"].sel(fmax=view.fmax(CONVERGENCE_FMAX_HZ))
        yield {"misses": search_rows.misses_value(rate, published.REALIZATIONS)}, view
    lowest = {}
    for amplitude in (None, *AMPLITUDES_NM):
        view = _pools(study, amplitude)
        if view is None:
            continue
        at = {"fmax": view.fmax(CONVERGENCE_FMAX_HZ)}
        at["amplitude"] = view.cube["amplitude"].values[0] if amplitude is None else view.amplitude(amplitude)
        curve = minimum_curve(view.cube.sel({k: [v] for k, v in at.items()})).compute()
        reached = float(view.needed["hit_rate"].sel(at).mean())
        key = "starts_noise_free" if amplitude is None else f"starts_{amplitude:g}"
        yield {key: search_rows.starts_value(curve, amplitude is not None, reached, RESULTS[key].n)}, view
        lowest[amplitude] = curve["minimum"].isel(amplitude=0, fmax=0)
    if all(a in lowest for a in AMPLITUDES_NM):
        assert view is not None
        weak, strong = xr.align(*(lowest[a] for a in AMPLITUDES_NM))
        yield {"cost_order": search_rows.cost_order_value(weak, strong, RESULTS["cost_order"].n)}, view


def _pools(study: StudyView, amplitude: float | None) -> GroupView | None:
    """The group of Fig. 3B with noise at an amplitude or (None) without noise."""
    fmax = CONVERGENCE_FMAX_HZ
    return (
        groups.noise_free(study, fmax, LEAST_POOL)
        if amplitude is None
        else groups.pools(study, fmax, amplitude, LEAST_POOL)
    )


class _Floors:
    """Mean |bias| from chance alone, in studies of the paper's size, of the rows about bias."""

    def __init__(self, study: StudyView) -> None:
        self._study = study

    def of(self, key: str) -> float:
        """NaN for another row."""
        if key not in self._keys:
            return float("nan")
        names, fmax = self._keys[key]
        view = groups.accuracy(self._study, [fmax], AMPLITUDES_NM)
        cells = None if view is None else view.cells if len(names) == len(accuracy_rows.TWELVE) else view.combined
        if view is None or cells is None:
            return float("nan")
        cells = view.at(cells[["estimate", "truth"]].sel(parameter=list(names)), [fmax], AMPLITUDES_NM)
        n = cells["estimate"].notnull().sum("realization").max()
        scale = np.sqrt(np.maximum(n / published.REALIZATIONS, 1.0))  # the floor of a block
        return float(accuracy.floor_percent(cells).mean() * scale)

    @cached_property
    def _keys(self) -> dict[str, tuple[tuple[str, ...], float]]:
        sets = {12: accuracy_rows.TWELVE, 10: accuracy_rows.TEN, 2: accuracy_rows.TWO}
        return {f"bias_{n}_{f:g}": (names, f) for n, names in sets.items() for f in FMAX_HZ}
