"""A whole study as the tables use it: its groups and their best fits, read once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import xarray as xr

from mcstudy.analysis.context import covariance_of, group_of, model_of, nearest, points_of, provenance_of
from mcstudy.analysis.derived import combined_when_read, derived_when_read
from mcstudy.analysis.efficiency import bounds_on_sd
from mcstudy.analysis.search.convergence import starts_needed
from mcstudy.analysis.selection import ERROR, best, outcomes, realizations
from mcstudy.analysis.slabs import in_slabs, summed
from mcstudy.analysis.sweeps import alone, cells_of
from mcstudy.errors import InputError
from mcstudy.files.sections import leaves
from mcstudy.fitting.standard_errors import overlap_of
from mcstudy.models.quantities import quantities
from mcstudy.stance.feedback import Model
from mcstudy.study.design import FITTED, Group
from mcstudy.study.instability import instability
from mcstudy.study.models import simulated_model, with_model_values

_NEEDED = (
    "estimate",
    ERROR,
    "cost",
    "status",
    "at_bound",
    "growth_rate",
    "truth",
    "lower",
    "upper",
    "n_frequencies",
)


class GroupView:
    """One group: the cube (lazy), and its best fits (in memory: they are smaller by the number of starts)."""

    def __init__(self, name: str, cube: xr.Dataset) -> None:
        self.name, self.cube = name, alone(cube)
        self.group: Group = group_of(self.cube)
        self.model: Model = model_of(self.cube)
        self.provenance = provenance_of(self.cube)

    @cached_property
    def cells(self) -> xr.Dataset:
        """Best start of every cell."""

        def best_needed(cube: xr.Dataset) -> xr.Dataset:
            cells = best(cube)
            return cells[[n for n in _NEEDED if n in cells]]

        read = self.cube[[n for n in _NEEDED if n in self.cube]]
        return in_slabs(read, best_needed).assign_coords(frequency=self.cube["frequency"])

    @cached_property
    def combined(self) -> xr.Dataset | None:
        """`cells` with the stiffnesses combined; None for a model without such pairs."""
        cells = self.cells  # a cube that cannot be read is no model without such pairs
        try:
            return combined_when_read(cells)
        except InputError:
            return None

    @cached_property
    def derived(self) -> xr.Dataset | None:
        """`cells` as the quantities that the model derives from its parameters; None for one without."""
        cells = self.cells
        return derived_when_read(cells) if self.model.derived else None

    @cached_property
    def units(self) -> dict[str, str]:
        """Units of the parameters and of the quantities derived from them, by the names that cells have."""
        return {q.label: q.unit for q in quantities(self.model)}

    @cached_property
    def bounds_on_sd(self) -> xr.Dataset | None:
        """Cramér-Rao and linearised standard deviations; None where the group has no (complete) noise covariance."""
        return self._bounds_on_sd(self.cells)

    @cached_property
    def derived_bounds_on_sd(self) -> xr.Dataset | None:
        """The same for `derived`."""
        return None if self.derived is None else self._bounds_on_sd(self.derived)

    def _bounds_on_sd(self, cells: xr.Dataset) -> xr.Dataset | None:
        if self._covariance is None:
            return None
        return bounds_on_sd(
            cells, self.model, self._covariance, overlap_of(points_of(self.cube), len(self.model.stimulus_names))
        )

    @cached_property
    def _covariance(self) -> xr.DataArray | None:
        if "noise_covariance" not in self.cube or not self.noisy:
            return None
        covariance = covariance_of(self.cube).compute()
        return covariance if bool(np.isfinite(covariance).all()) else None

    @cached_property
    def simulated(self) -> Model:
        """The model of the body that was simulated: `model`, unless the study gives it effects of its own."""
        return simulated_model(self.group)

    @cached_property
    def instability(self) -> str:
        """Growth rate of an unstable true body as text; empty for a stable one."""
        return instability(self.simulated)

    @property
    def noisy(self) -> bool:
        """Whether realizations differ by noise (else they are pools of starts for the same data)."""
        return self.group.noisy

    @cached_property
    def counts(self) -> xr.Dataset:
        """Numbers of fits (``fits``, see `mcstudy.analysis.selection.outcomes`) and of `realizations` by outcome."""
        return summed(self.cube[["cost", "status"]], lambda cube: realizations(cube).assign(fits=outcomes(cube)))

    @cached_property
    def needed(self) -> xr.Dataset:
        """``value``, ``missed``, ``missed_upper``, ``hit_rate`` of `search.convergence.starts_needed`."""
        names = ["value", "missed", "missed_upper", "hit_rate"]
        return in_slabs(self.cube[["cost", "status"]], lambda cube: starts_needed(cube)[names])

    @cached_property
    def differences(self) -> list[str]:
        """Settings in which the group differs from the defaults of a study file, ``field = value``."""
        default = Group(realizations=1, starts=1, fmax=self.group.fmax, amplitude=self.group.amplitude)
        same = self.group.model.kind == default.model.kind
        if self.group.model.declared:
            return [d for d in self.differences_from(default) if not d.startswith("model.")]
        return self.differences_from(with_model_values(default) if same else default)

    def differences_from(self, other: Group) -> list[str]:
        """Settings in which the group differs from ``other``, ``field = value`` of this group."""
        theirs, ours = (
            dict(leaves({s: getattr(g, s).model_dump(mode="json") for s in FITTED})) for g in (other, self.group)
        )

        def differs(field: str, value: object) -> bool:
            """Noise of the recording stands in designs that have some; other fields that stand in few are left out."""
            if field in theirs:
                return bool(theirs[field] != value)
            return field.startswith(("noise.measurement.", "effects.truth.")) and bool(value)

        return [f"{field} = {value}" for field, value in ours.items() if differs(field, value)]

    def fmax(self, value: float) -> float | None:
        """The group's Fmax nearest to ``wanted``, or None."""
        return nearest(self.cube["fmax"].values, value)

    def amplitude(self, value: float) -> float | None:
        """The group's amplitude nearest to ``wanted``, or None."""
        return nearest(self.cube["amplitude"].values, value)

    def within(self, fmax: float, f: np.ndarray) -> np.ndarray:
        """Which of the frequencies ``f`` (Hz) a fit up to ``fmax`` uses."""
        last = int(self.cube["n_frequencies"].sel(fmax=fmax))
        return np.asarray(f <= self.cube["frequency"].values[last - 1] * (1 + 1e-9))

    def at(self, cells: xr.Dataset, fmax: Sequence[float], amplitude: Sequence[float]) -> xr.Dataset:
        """``cells`` at those Fmax and amplitudes, relabelled with exactly the values asked for."""
        coordinates = {"fmax": [self.fmax(f) for f in fmax], "amplitude": [self.amplitude(a) for a in amplitude]}
        chosen = cells.isel({dim: _run(cells.get_index(dim).get_indexer(x)) for dim, x in coordinates.items()})
        return chosen.assign_coords(fmax=list(fmax), amplitude=list(amplitude))


def _run(positions: np.ndarray) -> slice | np.ndarray:
    """Positions as a slice where they follow one another: a view of all estimates, not a copy."""
    first = int(positions[0]) if positions.size else 0
    return slice(first, first + positions.size) if (np.diff(positions) == 1).all() else positions


class StudyView:
    """All non-empty groups of a cube."""

    def __init__(self, tree: xr.DataTree) -> None:
        self.attributes = dict(tree.attrs)
        groups = {name: node.to_dataset() for name, node in tree.children.items()}
        apart = {name: cells_of(data) or {name: data} for name, data in groups.items()}
        self.groups = {name: GroupView(name, data) for cells in apart.values() for name, data in cells.items()}
