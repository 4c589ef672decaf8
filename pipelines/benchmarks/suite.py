"""All benchmarks by name, in the order in which they run."""

from __future__ import annotations

from collections.abc import Callable

from pipelines.benchmarks import (
    basin_hopping,
    diagnosis,
    framework,
    kernel_sizes,
    kernel_time,
    large_cubes,
    latency,
    limits,
    paper_solver,
    profiles,
    scale,
    speedup,
    stability_search,
    starts_needed,
    studies,
    wheel,
)
from pipelines.benchmarks.report import Result, Sizes

BENCHMARKS: dict[str, Callable[[Sizes], Result]] = {
    "speedup": speedup.run,
    "basin_hopping": basin_hopping.run,
    "kernel": kernel_time.run,
    "kernel_sizes": kernel_sizes.run,
    "stability": stability_search.run,
    "starts": starts_needed.run,
    "paper_solver": paper_solver.run,
    "study": studies.whole_study,
    "plan": studies.planner,
    "limits": limits.run,
    "growth": studies.growth,
    "workers": studies.workers,
    "framework": framework.run,
    "diagnosis": diagnosis.run,
    "profiles": profiles.run,
    "latency": latency.run,
    "show": large_cubes.run,
    "wheel": wheel.run,
    "scale": scale.run,
}
