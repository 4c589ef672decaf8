"""Everything that is known about the designs with one Fmax, and what follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mcstudy.planning.fits import FULL, LINEARISED, TRUTH, Design, Fitter
from mcstudy.planning.local_model import Band, LocalModel, Prediction, scaled, unit
from mcstudy.planning.multilevel import Draws, Estimate, best_share, difference_of, estimated, relative_cost, unlike
from mcstudy.planning.space import AMPLITUDE, CYCLES, Space
from mcstudy.planning.targets import Target

FIRST = 64
"""Realizations of the first look at an Fmax, and fewest of any look."""

RUNG = {TRUTH: 128, LINEARISED: 64}
"""Draws behind every value of the prediction: fewer of those that cost more."""

DRAWS_A_REALIZATION = 20
"""Draws of the control for every realization in a first look, at most."""

ALIKE = 0.8
"""Correlation of the errors at neighbouring designs that share realizations, as expected before a look."""

RUNGS = 9
"""Signals at which a prediction is computed, from the control alone."""

TRUSTED = 0.05
"""Fits from the true values predict a measure if what they miss of it varies by less than this (`difference_of`)."""

UNKNOWN = 3.0
"""Error of a prediction without a single usable value, on the scale of the model."""

WORTH = 0.9
"""A control is used if it is expected to need less than this fraction of the fits."""


@dataclass(frozen=True)
class Look:
    """One design that was looked at: ``found`` is every target's measure relative to its limit.

    ``realizations``: fitted from all starts. ``draws``: of the control.
    """

    design: Design
    realizations: int
    draws: int
    found: tuple[Estimate, ...]


@dataclass(frozen=True)
class Candidate:
    """A design with what the model says of it; ``excess`` is that of the target that binds."""

    cycles: int
    amplitude: float
    cost: float
    excess: float

    @property
    def reached(self) -> bool:
        """Whether every target is met."""
        return self.excess <= 0


@dataclass
class Arm:
    """Designs with one Fmax.

    Attributes
    ----------
    targets: those that the design decides. realizations: of the study, which the Monte Carlo errors among them have.
    control: kind of the cheap fits; None before the first look, `FULL` for none. share: realizations for each draw of
    it. relative_cost: expected cost of both, relative to complete fits alone.
    """

    fmax: float
    space: Space
    targets: tuple[Target, ...]
    fitter: Fitter
    realizations: int
    looks: list[Look] = field(default_factory=list)
    control: str | None = None
    share: float = 1.0
    relative_cost: float = 1.0
    _predictions: list[Prediction] = field(default_factory=list)
    _models: list[LocalModel] = field(default_factory=list)

    def factor(self, target: Target) -> float:
        """From values of a measure to ratios to its limit."""
        return target.factor / target.limit / (np.sqrt(self.realizations) if target.mcse else 1.0)

    def prediction_fits(self, kind: str = TRUTH) -> int:
        """Fits that `predict` makes."""
        return len(self._signals()) * (RUNG[kind] if self.fitter.controls else FIRST)

    def least_fits(self, realizations: int = FIRST) -> int:
        """Fits that a first look needs: one draw of the control for every realization, where there is a control."""
        kinds = len(self.fitter.controls)
        return realizations * (self.fitter.group.starts + kinds + min(kinds, 1))

    def _signals(self) -> np.ndarray:
        low, high = (self.space.signal(c, a) for c, a in zip(self.space.cycles, self.space.amplitude, strict=True))
        return np.geomspace(low, high, RUNGS if high > 1.02 * low else 1)

    def predict(self, kind: str = TRUTH) -> None:
        """Predict every measure over the signal, from one kind of cheap fits."""
        cycles = int(np.clip(self.fitter.group.stimulus.cycles, *self.space.cycles))
        signals = self._signals()
        rungs = [Design(cycles, float(s / self.space.signal(cycles, 1.0)), self.fmax) for s in signals]
        if self.fitter.controls:
            draws = [self.fitter.draws(rung, kind, RUNG[kind]) for rung in rungs]
        else:
            draws = [self.fitter.realizations(rung, kind, FIRST) for rung in rungs]
        self._predictions = [self._predicted(target, np.log(signals), draws) for target in self.targets]
        self._fit()

    def _predicted(self, target: Target, log_signal: np.ndarray, draws: Sequence[np.ndarray]) -> Prediction:
        """A measure at every signal with its errors, from the same draws of the data at each."""
        values = [target.of(x) for x in draws]
        more = [np.append(v, u) for v, u in zip(values, unlike(values), strict=True)]
        estimates, changed = (
            [estimated(Draws(v, target.truth), target.measure).times(self.factor(target)) for v in every]
            for every in (values, more)
        )
        usable = np.array([np.isfinite(e.value) and np.isfinite(e.error) for e in estimates])
        if not usable.any():  # as if nothing were known of the measure
            return Prediction(log_signal[:1], np.zeros(1), np.zeros((1, 0)), np.full(1, UNKNOWN))
        signed = target.measure.signed
        value, other = (scaled(np.array([e.value for e in every]), signed) for every in (estimates, changed))
        shared = np.stack([e.own * unit(e, signed) for e in estimates])
        return Prediction(log_signal[usable], value[usable], shared[usable], np.abs(other - value)[usable])

    def look(self, design: Design, realizations: int, draws: int = 0, most: float = np.inf) -> None:
        """Fit a design and update the model; with so many draws of the control, if there is one, `draws` by default.

        ``most``: fits that the look may make, enough for its realizations (`least_fits`). What is left of them is
        spent on the control: its draws, and a prediction from it.
        """
        most += self.fitter.spent.fits
        full = self.fitter.realizations(design, FULL, realizations)
        first = self.control is None
        if self.control in (None, FULL):  # a few realizations may refuse a control by chance
            missed = self._missed(design, full, self.fitter.controls if first else self.fitter.controls[-1:])
            self._choose_control(design, missed)
            if first:
                self._choose_prediction(missed, most - self.fitter.spent.fits - realizations)
        control = sample = None
        if self.control != FULL:
            before = next((k.draws for k in self.looks if k.design == design), 0)
            wanted = min(draws or self.draws(realizations), before + most - self.fitter.spent.fits)
            if wanted >= realizations:
                control = self.fitter.realizations(design, str(self.control), realizations)
                sample = self.fitter.draws(design, str(self.control), int(wanted))
        measures = tuple(self._of(target, full, control, sample) for target in self.targets)
        self.looks = [look for look in self.looks if look.design != design]
        self.looks.append(Look(design, realizations, 0 if sample is None else len(sample), measures))
        self._fit()

    def draws(self, realizations: int) -> int:
        """Draws of the control beside so many realizations, where nothing else says how many."""
        if self.control in (None, FULL):
            return 0
        return int(min(DRAWS_A_REALIZATION, max(1.0, 1 / max(self.share, 1e-9))) * realizations)

    def _of(
        self, target: Target, full: np.ndarray, control: np.ndarray | None = None, sample: np.ndarray | None = None
    ) -> Estimate:
        """A measure relative to its limit.

        A few realizations may hold none in which complete and cheap fit differ much. The error then counts one more:
        beside fits from the true values, and over cycles, where repeated searches scattered twice as much as stated
        without it (``pipelines/docs/reference/solve.md``); over the amplitude they did not.
        """
        others = (None if x is None else target.of(x) for x in (control, sample))
        estimate = estimated(Draws(target.of(full), target.truth, *others), target.measure)
        if control is not None and (self.control == TRUTH or CYCLES in self.space.over):
            plain = estimated(Draws(target.of(full), target.truth), target.measure)
            estimate = estimate.with_unseen(float(np.abs(plain.own).max()))
        return estimate.times(self.factor(target))

    def _missed(self, design: Design, full: np.ndarray, kinds: Sequence[str]) -> dict[str, float]:
        """What cheap fits of some kinds miss of complete ones, for the target that they suit least."""
        missed = {}
        for kind in kinds:
            cheap = self.fitter.realizations(design, kind, len(full))
            missed[kind] = max(difference_of(Draws(t.of(full), t.truth, t.of(cheap)), t.measure) for t in self.targets)
        return missed

    def _choose_control(self, design: Design, missed: dict[str, float]) -> None:
        """Whether a control is worth its cost.

        Fits that start at the true values do not end in far minima. Where these rarely do, the realizations of a first
        look may hold none of them, and the difference would seem to be zero. So such fits are the control only where
        there is no linearised start.
        """
        self.control = FULL
        for kind in self.fitter.controls[-1:]:
            costs = self.fitter.cost(kind), self.fitter.cost(FULL) + self.fitter.simulation(design.cycles)
            relative = relative_cost(missed[kind], *costs)
            if relative < WORTH:
                self.control, self.relative_cost, self.share = kind, relative, best_share(missed[kind], *costs)

    def _choose_prediction(self, missed: dict[str, float], most: float) -> None:
        """A new prediction, of at most so many fits, where complete fits often end in far minima: fits from the true
        values predict neither how large a measure is then nor where it falls."""
        if not missed or missed[TRUTH] <= TRUSTED:
            return
        kind = min(missed, key=missed.__getitem__)
        if kind != TRUTH and self.prediction_fits(kind) <= most:
            self.predict(kind)

    def _fit(self) -> None:
        self._models = self._fitted(self.looks)

    def _fitted(self, looks: Sequence[Look]) -> list[LocalModel]:
        points = self.points([k.design.cycles for k in looks], [k.design.amplitude for k in looks])
        cycles = [k.design.cycles for k in looks]
        return [
            LocalModel(prediction, target.measure.signed, points, [k.found[i] for k in looks], cycles)
            for i, (target, prediction) in enumerate(zip(self.targets, self._predictions, strict=True))
        ]

    def expected(self, design: Design, realizations: int, draws: int) -> list[LocalModel]:
        """Every target's model after one more look, with the errors that it is expected to have.

        Only the errors of these models mean something. The look is given the relative error of the nearest one, and
        errors that are correlated with it.
        """
        signal = self.space.signal(design.cycles, design.amplitude)
        nearest = min(
            self.looks,
            key=lambda k: (
                k.design.cycles != design.cycles,
                abs(np.log(self.space.signal(k.design.cycles, k.design.amplitude) / signal)),
            ),
        )
        alike = 1.0 if nearest.design == design else ALIKE
        measures = tuple(e.with_draws(realizations, draws, alike) for e in nearest.found)
        others = [k for k in self.looks if k.design != design]
        return self._fitted([*others, Look(design, realizations, draws, measures)])

    def points(self, cycles: Sequence[float] | np.ndarray, amplitude: Sequence[float] | np.ndarray) -> np.ndarray:
        """Coordinates (n, 2) of designs for the model."""
        used = np.asarray(cycles, dtype=float) - self.space.discard
        return np.stack([np.log(np.asarray(amplitude, dtype=float)), np.log(used)], axis=1).reshape(-1, 2)

    def bands(
        self, cycles: np.ndarray, amplitude: np.ndarray, expected: Sequence[LocalModel] | None = None
    ) -> list[Band]:
        """What every target's model says at designs; with the errors of the ``expected`` models where given."""
        points = self.points(cycles, amplitude)
        bands = [model.at(points) for model in self._models]
        if expected is None:
            return bands
        return [replace(b, error=model.at(points).error) for b, model in zip(bands, expected, strict=True)]

    def excess(
        self, cycles: np.ndarray, amplitude: np.ndarray, expected: Sequence[LocalModel] | None = None
    ) -> np.ndarray:
        """Lower end, middle and upper end of the largest excess over all targets, (3, n)."""
        bands = self.bands(cycles, amplitude, expected)
        return np.stack([np.max([getattr(b, side) for b in bands], axis=0) for side in ("low", "middle", "high")])

    @property
    def hopeless(self) -> bool:
        """Whether no allowed design reaches the targets even at the lower ends of their 95 % intervals."""
        return not self.cheapest(0).reached

    def cheapest(self, side: int = 1) -> Candidate:
        """The cheapest design whose excess is at most 0, at the lower end (0), middle (1) or upper end (2) of its band.

        The design with the smallest excess where there is none.
        """
        cycles, amplitude = self.space.grid()
        excess = self.excess(cycles, amplitude)[side]
        fine = excess <= 0
        k = self._first(cycles, amplitude, fine)
        if k is None:
            k = int(excess.argmin())
        elif AMPLITUDE in self.space.over:
            amplitude, excess = amplitude.copy(), excess.copy()
            amplitude[k], excess[k] = self._finer(cycles[k], amplitude[k], side)
        cost = self.space.cost(cycles[k : k + 1], amplitude[k : k + 1], self.fmax)
        return Candidate(int(cycles[k]), float(amplitude[k]), float(cost[0]), float(excess[k]))

    def _finer(self, cycles: int, amplitude: float, side: int) -> tuple[float, float]:
        """The cheapest amplitude between the grid's neighbours of this one that still is enough."""
        low, high = self.space.amplitude
        step = (high / low) ** (1 / (len(self.space.amplitudes()) - 1))
        below = np.geomspace(max(low, amplitude / step), amplitude, 41)
        fine = np.append(below, np.geomspace(amplitude, min(high, amplitude * step), 41)[1:])
        count = np.full(fine.size, cycles)
        excess = self.excess(count, fine)[side]
        k = self._first(count, fine, excess <= 0)
        k = below.size - 1 if k is None else k
        return float(fine[k]), float(excess[k])

    def _first(self, cycles: np.ndarray, amplitude: np.ndarray, fine: np.ndarray) -> int | None:
        """Position of the cheapest of the designs that are ``fine``; None where none is."""
        order = self.space.order(cycles, amplitude, self.fmax)
        return int(order[fine[order].argmax()]) if fine.any() else None

    def crossing(
        self, axis: str, at: Candidate, expected: Sequence[LocalModel] | None = None
    ) -> tuple[float, float, float]:
        """The cheapest value of an axis that meets the targets, with the others as ``at``: lower end, best, upper end.

        Where the cost rises along the axis it is the smallest value that meets them. NaN where none does.
        """
        values = np.geomspace(*self.space.ends(axis), 2001)
        cycles = values if axis == CYCLES else np.full(values.size, float(at.cycles))
        amplitude = values if axis == AMPLITUDE else np.full(values.size, at.amplitude)
        ends = []
        for excess in self.excess(cycles, amplitude, expected):
            k = self._first(cycles, amplitude, excess <= 0)
            ends.append(np.nan if k is None else float(values[k]))
        return ends[0], ends[1], ends[2]
