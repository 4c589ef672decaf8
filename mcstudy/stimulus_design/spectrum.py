"""The optimal spectrum of a design file: lines, what the sequence has there, limits, phases, and predicted errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mcstudy.errors import DesignError, InputError
from mcstudy.stance.feedback import Model
from mcstudy.stance.information import expected_line_covariance, line_information, standard_errors, unit_variance
from mcstudy.stance.line_stimulus import LineStimulus, Stimulus
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stimulus_design.bodies import drawn, model_of, relative
from mcstudy.stimulus_design.criteria import Criterion
from mcstudy.stimulus_design.design_file import DIFFERENCE, DesignFile
from mcstudy.stimulus_design.difference import Difference, difference, require_shown
from mcstudy.stimulus_design.evoked_sway import SwayLimit
from mcstudy.stimulus_design.optimum import Allowed, Optimum, grouped, maximum
from mcstudy.stimulus_design.phases import crest_factor, low_crest
from mcstudy.streams import stream
from mcstudy.study.group import LinesSection
from mcstudy.study.measure import stimulus

ROUNDS = 6
"""Most times that a spectrum is sought with a lower RMS because its peak was above the limit."""


REFERENCES = 2
"""Reference spectra for the difference of two models: the sequence, and the optimum near it."""


@dataclass(frozen=True, eq=False)
class Size:
    """How large a stimulus is: what the limits are about.

    Attributes
    ----------
    rms, peak: of the stimulus, in its unit. rate: RMS of its rate of change, unit/s. crest_factor: peak over RMS.
    sway: RMS of the evoked sway of each angle, rad, (A,).
    """

    rms: float
    peak: float
    rate: float
    crest_factor: float
    sway: np.ndarray


@dataclass(frozen=True, eq=False)
class Designed:
    """An optimal stimulus.

    Attributes
    ----------
    file: what was asked. model: the body of the file. sequence, stimulus: the sequence, and the design.
    f: odd lines up to fmax, Hz, (K,). before, after: powers of both there (squared moduli of Fourier coefficients).
    empty: detection lines, (K,) bool. optimum: of the powers of the lines that are not empty.
    limits: share of each limit that the design uses, by name (ratios of powers).
    difference: of the criterion "difference", for the body of the file; None for the others.
    """

    file: DesignFile
    model: Model
    sequence: Stimulus
    stimulus: LineStimulus
    f: np.ndarray
    before: np.ndarray
    after: np.ndarray
    empty: np.ndarray
    optimum: Optimum
    limits: dict[str, float]
    difference: Difference | None = None

    @property
    def lines(self) -> LinesSection:
        """The design as ``[stimulus.lines]`` of a study file."""
        s = self.stimulus
        return LinesSection(harmonic=s.harmonic, weight=s.weight, phase_deg=s.phase_deg)


def designed(file: DesignFile) -> Designed:
    """The optimal stimulus of a design file.

    Raises
    ------
    DesignError
        The limits allow no stimulus (the line names the limit), or the lines do not determine the parameters.
    """
    base, seed, limits = file.group(), file.design.seed, file.limits
    model = model_of(file, file.model)
    models = [model, *(model_of(file, b) for b in drawn(file, file.prior.bodies, stream(seed, "design_prior")))]
    sequence = stimulus(base, file.design.amplitude)
    c = sequence.coefficients()
    harmonic = np.arange(1, int(file.design.fmax * sequence.period_s + 0.5) + 1, 2)
    harmonic = harmonic[2 * harmonic < sequence.samples]
    f, before = harmonic / sequence.period_s, np.abs(c[harmonic]) ** 2
    empty = grouped(harmonic, file.design.detection, stream(seed, "design_detection"))
    used = ~empty
    try:
        shown, best = _objective(file, models, f, before, used)
    except InputError as error:
        raise DesignError(str(error)) from None
    sway = SwayLimit.of(file, model, sequence, f[used])
    rms, name = limits.rms, "limits.rms"
    for _ in range(ROUNDS):
        allowed = _allowed(file, sequence, f, used, rms, name)
        try:
            optimum = sway.optimum(partial(_within, best, allowed))
        except InputError as error:
            raise DesignError(str(error)) from None
        design = _with_phases(file, sequence, harmonic[used], optimum.x)
        size = size_of(model, design)
        if limits.crest_factor and size.crest_factor > limits.crest_factor:
            raise DesignError(
                f"limits.crest_factor: the lowest found in {file.design.phase_starts} starts is "
                f"{size.crest_factor:.3g}, got a limit of {limits.crest_factor:g}"
            )
        if not limits.peak or size.peak <= limits.peak:
            break
        rms, name = 0.995 * limits.peak / size.crest_factor / _rms(sequence), "limits.peak"
    else:
        raise DesignError(f"limits.peak: the lowest peak found is {size.peak:.4g}, got a limit of {limits.peak:g}")
    after = np.zeros(f.size)
    after[used] = optimum.x
    shares = dict(zip(allowed.names, allowed.used(optimum.x).tolist(), strict=True))
    shares["limits.sway"] = sway.used(optimum.x)
    if limits.crest_factor:
        shares["limits.crest_factor"] = (size.crest_factor / limits.crest_factor) ** 2
    if limits.peak:
        shares["limits.peak"] = (size.peak / limits.peak) ** 2
    return Designed(file, model, sequence, design, f, before, after, empty, optimum, shares, shown)


def _criterion(file: DesignFile, models: list[Model], f: np.ndarray) -> Criterion:
    """The criterion of the parameters, for relative errors."""
    each = [information(file, m, f) * np.outer(relative(m), relative(m)) for m in models]
    return Criterion(np.array(each), _columns(file, models[0]))


def _within(best: Callable[[Allowed], Optimum], allowed: Allowed, sway: np.ndarray) -> Optimum:
    """The best allowed powers with further limits of the sway, costs (L, K)."""
    names = (*allowed.names, *["limits.sway"] * len(sway))
    return best(Allowed(np.concatenate([allowed.cost, sway]), allowed.least, names))


def _objective(
    file: DesignFile, models: list[Model], f: np.ndarray, before: np.ndarray, used: np.ndarray
) -> tuple[Difference | None, Callable[[Allowed], Optimum]]:
    """What the allowed powers shall be best for; with it, for two models, their difference for the first body.

    The criterion of two models holds near a reference spectrum: first that of the sequence, ``before`` (K,), then the
    optimum for that.
    """
    if file.design.criterion != DIFFERENCE:
        return None, partial(maximum, _criterion(file, models, f[used]))
    for m in models:
        relative(m)  # the errors of parameters are relative
    shown = difference(models[0], file.design.effects, f, before, whitener(file, models[0], f))
    require_shown(shown, before, file.stimulus.kind)

    def near(power: np.ndarray) -> Criterion:
        each = [difference(m, file.design.effects, f[used], power, whitener(file, m, f[used])) for m in models]
        return Criterion(np.array([d.information for d in each]), each[0].columns)

    first = near(before[used])

    def best(allowed: Allowed) -> Optimum:
        optimum = maximum(first, allowed)
        for _ in range(1, REFERENCES):
            optimum = maximum(near(optimum.x), allowed)
        return optimum

    return shown, best


def whitener(file: DesignFile, model: Model, f: np.ndarray) -> np.ndarray:
    """Of the errors (K, Y, Y) of lines with a unit Fourier coefficient, in all cycles that are not discarded."""
    duration = (file.cycles - file.stimulus.discard) * (3**file.stimulus.stages - 1) * file.stimulus.state_s
    measured = file.noise.measurement.of(model.output_units)
    recorded = None if measured is None else measured.psd_without_ramp(f, duration, file.stimulus.rate_hz)
    noise = file.noise.of(model.angles)
    C = expected_line_covariance(model, model.truth, noise, f, np.ones(f.size), duration, recorded)
    return unit_variance(C)


def information(file: DesignFile, model: Model, f: np.ndarray) -> np.ndarray:
    """Fisher information (K, P, P) of lines with a unit Fourier coefficient, in all cycles that are not discarded."""
    return line_information(model, model.truth, f, whitener(file, model, f))


def predicted(file: DesignFile, model: Model, f: np.ndarray, power: np.ndarray, bounded: bool = False) -> np.ndarray:
    """Coefficients of variation (P,) at the Cramer-Rao bound for lines ``f`` with ``power``.

    ``bounded``: with what the bounds of the fit add, to first order: the information of a normal distribution with the
    variance of the uniform one between them. A parameter that the data do not determine then scatters by 29 % of the
    distance between its bounds, and the others as if it were known that well.
    """
    whole = np.tensordot(power, information(file, model, f), axes=1)
    if bounded:
        whole = whole + np.diag(12 / (model.upper - model.lower) ** 2)
    return standard_errors(whole, np.eye(len(whole))) / relative(model)


def size_of(model: Model, periodic: Stimulus) -> Size:
    """How large a stimulus is, for one body; all its lines count, also those above the highest fitted."""
    c = periodic.coefficients()
    k = np.flatnonzero(c)
    f, power = k / periodic.period_s, np.abs(c[k]) ** 2
    response = np.abs(frf(model, model.truth, f)) ** 2
    wave = periodic.waveform()
    return Size(
        rms=float(np.sqrt(2 * power.sum())),
        peak=float(np.abs(wave).max()),
        rate=float(np.sqrt(2 * (power * (2 * np.pi * f) ** 2).sum())),
        crest_factor=crest_factor(wave),
        sway=np.sqrt(2 * power @ response),
    )


def noise_sway(file: DesignFile, model: Model, top_hz: float = 20.0) -> np.ndarray:
    """RMS of the sway that sensor noise alone evokes within one cycle's lines up to ``top_hz``, rad, (A,)."""
    period = file.period_s
    f = np.arange(1, int(top_hz * period) + 1) / period
    noise = file.noise.of(model.angles)
    density = np.einsum("nii->ni", sway_psd(model, model.truth, noise, f)).real
    return np.asarray(np.sqrt(density.sum(axis=0) / period))


def _columns(file: DesignFile, model: Model) -> np.ndarray | None:
    """W of the criterion, for relative errors."""
    unit = np.eye(len(model.names))
    if file.design.criterion == "D":
        return None
    if file.design.criterion == "A":
        return unit
    if file.design.parameter not in model.names:
        raise DesignError(f"design.parameter: expected one of {', '.join(model.names)}, got {file.design.parameter!r}")
    return unit[:, [model.names.index(file.design.parameter)]]


def _allowed(file: DesignFile, sequence: Stimulus, f: np.ndarray, used: np.ndarray, rms: float, name: str) -> Allowed:
    """The limits that no body matters for, as shares of power; ``rms``: of the stimulus, set by the field ``name``."""
    c = sequence.coefficients()
    k = np.flatnonzero(c)
    every, power = k / sequence.period_s, np.abs(c[k]) ** 2
    rows, names = [np.ones(f.size) / power.sum() / rms**2], [name]
    if file.limits.rate:
        rows.append(f**2 / (power @ every**2) / file.limits.rate**2)
        names.append("limits.rate")
    kept = file.design.keep * np.abs(c[np.round(f * sequence.period_s).astype(int)]) ** 2
    return Allowed(np.array(rows)[:, used], kept[used], tuple(names))


def _with_phases(file: DesignFile, sequence: Stimulus, harmonic: np.ndarray, power: np.ndarray) -> LineStimulus:
    """The stimulus with these powers and phases of a low crest factor, in the convention of the sequence."""
    rng = stream(file.design.seed, "design_phases")
    phase = low_crest(harmonic, power, sequence.samples, rng, file.design.phase_starts)
    weight = np.sqrt(power / power.max())
    unit = LineStimulus(
        tuple(harmonic.tolist()),
        tuple(float(f"{w:.9g}") for w in weight),
        tuple(float(f"{d:.6f}") for d in np.degrees(phase) % 360),
        sequence.samples,
        sequence.rate_hz,
        1.0,
        file.stimulus.convention,
    )
    largest = float(np.sqrt(power.max() / (np.abs(unit.coefficients()) ** 2).max()))
    return replace(unit, amplitude=float(f"{largest:.9g}"))


def _rms(periodic: Stimulus) -> float:
    return float(np.sqrt(2 * (np.abs(periodic.coefficients()) ** 2).sum()))
