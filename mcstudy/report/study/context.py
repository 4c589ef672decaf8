"""The data of the page: the study, read once, and the group for each question."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import xarray as xr

from mcstudy.analysis.cache import Look
from mcstudy.analysis.publications.publication import Publication, cited
from mcstudy.analysis.results import open_for_tables
from mcstudy.analysis.show import SCHEMA
from mcstudy.analysis.show.summary import show_data
from mcstudy.analysis.view import GroupView, StudyView
from mcstudy.fitting.solvers import solvers
from mcstudy.report.numbers import finite
from mcstudy.text_tables import with_error


@dataclass(frozen=True, eq=False)
class Context:
    """A study and the numbers of ``mcstudy show`` about it, which ``numbers`` computes or has kept."""

    tree: xr.DataTree
    numbers: Callable[[StudyView], dict[str, Any]] = show_data

    @cached_property
    def study(self) -> StudyView:
        """Its groups."""
        return StudyView(self.tree)

    @cached_property
    def data(self) -> dict[str, Any]:
        """`mcstudy.analysis.show.summary.show_data`: what ``mcstudy show OUT --json`` prints."""
        return self.numbers(self.study)

    @property
    def name(self) -> str:
        """Name of the study."""
        return str(self.tree.attrs.get("title", "study"))

    @property
    def seed(self) -> int:
        """Seed of the study."""
        return int(self.tree.attrs["seed"])

    @cached_property
    def published(self) -> dict[str, dict[str, Any]]:
        """Rows *paper | ours* by key."""
        return {row["key"]: row for row in self.data["paper"]["rows"]}

    def counterpart(self, number: str, fmax: float = 0.0) -> dict[str, Any] | None:
        """The published row of a number on the first screen, see `Publication.headline`; None without one."""
        return self.published.get(self.publication.headline.get(number, "").format(fmax=f"{fmax:g}"))

    def cells(self, view: GroupView) -> list[dict[str, Any]]:
        """Numbers of every (amplitude, Fmax) of a group."""
        return list(self.data["groups"][view.name]["cells"])

    @cached_property
    def held(self) -> list[GroupView]:
        """Groups with at least one finished fit; of sweeps the first cell alone, where there is no other group."""
        views = list(self.study.groups.values())
        views = [g for g in views if g.group.cell is None] or views[:1]
        return [g for g in views if bool(g.cells["cost"].notnull().any())]

    @cached_property
    def publication(self) -> Publication:
        """The publication that the study is compared with."""
        return cited(self.data["paper"]["reference"])

    def _published(self, role: str) -> GroupView | None:
        """The group of a published figure, if it has finished fits."""
        view = self.publication.group(role, self.study)
        return view if view in self.held else None

    @cached_property
    def accuracy(self) -> GroupView | None:
        """The group for estimates with noise: the published one if there is one, else the one with most conditions."""
        noisy = [g for g in self.held if g.noisy and g.group.realizations > 1]
        return self._published("estimates") or max(
            noisy, key=lambda g: (len(g.group.fmax) * len(g.group.amplitude), g.group.realizations), default=None
        )

    @property
    def main(self) -> GroupView:
        """The group whose model and stimulus the page shows: needs no fits, so one that has not been run will do."""
        return self.accuracy or self.pools or self.theory or next(iter(self.study.groups.values()))

    @cached_property
    def others(self) -> list[GroupView]:
        """Further groups with noise whose settings differ from those of `accuracy`."""
        main = self.accuracy
        noisy = [g for g in self.held if g.noisy and g.group.realizations > 1 and g is not main]
        return [g for g in noisy if main is None or _settings(g) != _settings(main)]

    @cached_property
    def theory(self) -> GroupView | None:
        """The group without noise for figures of fits without noise."""
        free = [g for g in self.held if not g.noisy]
        return self._published("theory") or max(free, key=lambda g: (g.group.fmax[-1], g.group.starts), default=None)

    @cached_property
    def pools(self) -> GroupView | None:
        """The group with noise and most starts, for the number of starts needed and the waterfall."""
        noisy = [g for g in self.held if g.noisy]
        return self._published("pools") or max(noisy, key=lambda g: g.group.starts, default=None)

    @cached_property
    def free_pools(self) -> GroupView | None:
        """The group without noise for the number of starts needed."""
        return self._published("free_pools") or self.theory

    @cached_property
    def other_solvers(self) -> list[GroupView]:
        """Groups that differ from `pools` in nothing but the solver and its settings."""
        main = self.pools
        held = [g for g in self.held if main is not None and g is not main]
        return [g for g in held if _without_solver(g) == _without_solver(main)]


def context_of(path: Path, look: Look) -> Context:
    """The study of the cube at ``path``, which ``look`` looks at: its numbers are computed once and kept.

    Raises `StoreError` when it is not a cube of this version.
    """
    return Context(open_for_tables(path), lambda study: look.kept(SCHEMA, [], lambda: show_data(study)))


def _without_solver(view: GroupView | None) -> str:
    """Everything but the solver and its settings."""
    fit = {"solver", "tolerance", "max_iterations", *solvers()}
    return json.dumps(view and view.group.model_dump(mode="json", exclude={"fit": fit}), sort_keys=True)


def _settings(view: GroupView) -> str:
    """Everything but the axes."""
    axes = {"realizations", "starts", "fmax", "amplitude"}
    return json.dumps(view.group.model_dump(mode="json", exclude=axes), sort_keys=True)


def conditions(view: GroupView, ends_only: bool = False) -> list[tuple[float, float]]:
    """(amplitude, Fmax) with finished fits, by Fmax; or only the smallest and the largest amplitude of each."""
    done = view.cells["cost"].notnull().any("realization")
    out = []
    for f in view.cube["fmax"].values.tolist():
        amplitudes = [a for a in view.cube["amplitude"].values.tolist() if bool(done.sel(amplitude=a, fmax=f))]
        if ends_only and amplitudes:
            amplitudes = list(dict.fromkeys((amplitudes[0], amplitudes[-1])))
        out += [(a, f) for a in amplitudes]
    return out


def largest_amplitude(view: GroupView) -> float:
    """The largest amplitude with finished fits."""
    return max(a for a, _ in conditions(view))


def stat(result: dict[str, Any], factor: float = 1.0) -> str:
    """``value ± mcse`` of an entry of the summary."""
    value, mcse = (None if result[k] is None else factor * result[k] for k in ("value", "mcse"))
    return with_error(value, mcse)


def value_of(result: xr.Dataset) -> str:
    """``value ± mcse`` of a scalar Dataset."""
    return with_error(finite(result["value"]), finite(result["mcse"]))


def with_ends(statistic: dict[str, Any]) -> str:
    """A number of starts with its interval; a dash is an end that so few realizations cannot bound."""
    value, low, high = ("–" if statistic[k] is None else f"{statistic[k]:.0f}" for k in ("value", "lower", "upper"))
    return value if low == high == "–" else f"{value} [{low}, {high}]"
