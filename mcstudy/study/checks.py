"""What only the physics can tell is wrong with a group of a study file."""

from __future__ import annotations

import numpy as np

from mcstudy.errors import DesignError, InputError
from mcstudy.spectra.bands import PERIOD_S
from mcstudy.stance.feedback import Model
from mcstudy.study.design import Group
from mcstudy.study.measure import HIGHEST_HZ, frequency_points, kept_points, stimulus
from mcstudy.study.models import build_model

MAX_SAMPLES = 200_000_000
"""Longest record a study may ask for."""


def check(group: Group, model: Model | None = None) -> None:
    """Raise `DesignError` for the first thing that is wrong; its message starts with the field within the group.

    ``model``: fitted instead of the one the group describes.
    """
    model = build_model(group) if model is None else model
    _check_stimulus(group)
    _check_fit(group)
    _check_frequencies(group, model)


def _check_stimulus(group: Group) -> None:
    s = group.stimulus
    try:
        prts = stimulus(group, group.amplitude[0])
    except InputError as error:
        raise DesignError(str(error).replace("stimulus ", "stimulus.", 1)) from None
    if s.discard >= s.cycles:
        raise DesignError(f"stimulus.discard: expected fewer than cycles = {s.cycles}, got {s.discard}")
    if prts.samples * s.cycles > MAX_SAMPLES:
        raise DesignError(f"stimulus.cycles: expected a record of at most {MAX_SAMPLES} samples")
    if s.rate_hz < 4 * HIGHEST_HZ:
        raise DesignError(f"stimulus.rate_hz: expected at least {4 * HIGHEST_HZ} Hz, got {s.rate_hz}")
    if group.spectra.ramp == "remove" and s.discard == 0:
        raise DesignError("spectra.ramp: expected 'keep' when stimulus.discard = 0 (the ramp needs a sample before)")
    if group.spectra.points != "odd_lines" and abs(prts.period_s - PERIOD_S) > 1e-9:
        raise DesignError(
            f"spectra.points: expected 'odd_lines' for a period other than {PERIOD_S} s, got {group.spectra.points!r}"
        )
    if group.spectra.points == "odd_lines" and group.spectra.width != 1:
        raise DesignError(
            f"spectra.width: expected 1 for points 'odd_lines' (one line each), got {group.spectra.width}"
        )


def _check_fit(group: Group) -> None:
    if group.spectra.covariance == "through_loop" and (group.fit.cost != "ml" or group.simulator != "spectral"):
        raise DesignError(
            "spectra.covariance: expected 'even_lines' unless fit.cost = 'ml' and simulator = 'spectral', "
            "got 'through_loop'"
        )
    if group.fit.cost == "ml" and (group.simulator == "none" or min(group.noise.psd) == 0):
        raise DesignError(
            "fit.cost: expected 'paper' for a group without noise (there is nothing to weigh by), got 'ml'"
        )


def _check_frequencies(group: Group, model: Model) -> None:
    points, half_line = frequency_points(group).f, 0.5 / stimulus(group, group.amplitude[0]).period_s
    last = max(points[-1], HIGHEST_HZ)
    if group.fmax[0] < points[0] - half_line:
        raise DesignError(f"fmax: expected at least {points[0]:.4g} Hz, the first frequency, got {group.fmax[0]}")
    if group.fmax[-1] > last + half_line:
        raise DesignError(f"fmax: expected at most {last:.4g} Hz, the last frequency, got {group.fmax[-1]}")
    for f in group.spectra.exclude_hz:
        if np.abs(points - f).min() > half_line:
            raise DesignError(f"spectra.exclude_hz: expected frequencies of the FRF, got {f}")
    parameters, a_frequency = len(model.parameters), 2 * model.n_angles
    try:
        smallest = len(kept_points(group).below(group.fmax[0]))
    except InputError:
        smallest = 0
    if a_frequency * smallest < parameters:
        raise DesignError(
            f"fmax: expected at least {-(-parameters // a_frequency)} frequencies for {parameters} parameters, "
            f"{group.fmax[0]} Hz leaves {smallest}"
        )
