"""The report's figures: each function draws one panel on matplotlib axes (new ones by default) and returns them::

    tree = mcstudy.open_results("cube.zarr")
    figures.parameter_bars(tree["accuracy"], "K11")

Figures of a diagnosis are methods of ``diagnosis.plot``.
"""

from mcstudy.report.style import require_matplotlib

require_matplotlib()

from mcstudy.report.figures.accuracy import bias_bars, cv_bars, influence_shares, sensitivity_bars  # noqa: E402 - after the check
from mcstudy.report.figures.by_fmax import statistic_by_fmax  # noqa: E402
from mcstudy.report.figures.determined import determined_dots  # noqa: E402
from mcstudy.report.figures.efficiency import efficiency_dots  # noqa: E402
from mcstudy.report.figures.estimates import parameter_bars  # noqa: E402
from mcstudy.report.figures.optimiser import basin_atlas, bias_by_starts, cv_by_starts  # noqa: E402
from mcstudy.report.figures.pairs import correlation_map, estimate_scatter  # noqa: E402
from mcstudy.report.figures.responses import controller_gain, controller_phase, frf_gain, frf_phase  # noqa: E402
from mcstudy.report.figures.search import (  # noqa: E402
    controller_error,
    controller_error_by_noise,
    starts_curve,
    waterfall,
)
from mcstudy.report.figures.signals import (  # noqa: E402
    Signals,
    noise_spectrum,
    noise_sway_record,
    sensor_noise_record,
    simulation_error_frf,
    simulation_error_record,
    stimulus_record,
    stimulus_spectrum,
    sway_record,
)
from mcstudy.report.figures.stable_starts import hit_rate_bars  # noqa: E402
from mcstudy.report.figures.zipper import zipper  # noqa: E402

__all__ = [
    "Signals",
    "basin_atlas",
    "bias_bars",
    "bias_by_starts",
    "controller_error",
    "controller_error_by_noise",
    "controller_gain",
    "controller_phase",
    "correlation_map",
    "cv_bars",
    "cv_by_starts",
    "determined_dots",
    "efficiency_dots",
    "estimate_scatter",
    "frf_gain",
    "frf_phase",
    "hit_rate_bars",
    "influence_shares",
    "noise_spectrum",
    "noise_sway_record",
    "parameter_bars",
    "sensitivity_bars",
    "sensor_noise_record",
    "simulation_error_frf",
    "simulation_error_record",
    "starts_curve",
    "statistic_by_fmax",
    "stimulus_record",
    "stimulus_spectrum",
    "sway_record",
    "waterfall",
    "zipper",
]
