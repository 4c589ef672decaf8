"""The search on estimators whose properties are known exactly, so that its answers can be compared with the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from mcstudy.planning.arm import Arm
from mcstudy.planning.fits import FULL, LINEARISED, TRUTH, Design, Spent
from mcstudy.planning.multilevel import MEASURES, Draws, estimated
from mcstudy.planning.next_look import width
from mcstudy.planning.search import Rules, search
from mcstudy.planning.space import Space
from mcstudy.planning.targets import parse_targets
from mcstudy.stance.body import two_segment

MODEL = two_segment()
K12 = [p.name for p in MODEL.parameters].index("K12")
STARTS = 50
SEARCHES = 12


@dataclass
class KnownEstimator:
    """Estimates of K12 with a relative standard deviation of ``level`` at a signal of 1, falling with its ``power``.

    A fit ends with chance ``far(signal)`` in another minimum, at a third of the truth: the same fits at every design,
    or others if ``anew``. Fits from the true values never do. It has the methods of a `mcstudy.planning.fits.Fitter`
    that the search uses.
    """

    seed: int
    far: Callable[[float], float]
    level: float = 1.0
    power: float = 1.0
    anew: bool = False
    controls: tuple[str, ...] = (TRUTH, LINEARISED)
    spent: Spent = field(default_factory=Spent)
    made: dict[tuple[Design, str, bool], int] = field(default_factory=dict)
    group: Any = field(default_factory=lambda: SimpleNamespace(starts=STARTS, stimulus=SimpleNamespace(cycles=6)))

    def cv(self, signal: float) -> float:
        """The exact coefficient of variation."""
        p, sd = self.far(signal), self.level * signal**-self.power
        mean = 1 - 2 / 3 * p
        return float(np.sqrt((1 - p) * (sd**2 + 1) + p / 9 - mean**2) / mean)

    def _made(self, design: Design, kind: str, n: int, drawn: bool) -> np.ndarray:
        signal = design.amplitude * np.sqrt(design.cycles - 1)
        streams = np.random.default_rng([self.seed, drawn, 0 if drawn else design.cycles])
        z, u = streams.normal(0, 1, 20_000)[:n], streams.random(20_000)[:n]
        if self.anew:
            u = np.random.default_rng([self.seed, drawn, round(1e6 * signal)]).random(20_000)[:n]
        x = np.broadcast_to(MODEL.truth, (n, MODEL.truth.size)).copy()
        relative = 1 + z * self.level * signal**-self.power
        if kind != TRUTH:
            relative = np.where(u < self.far(signal), 1 / 3, relative)
        x[:, K12] *= relative
        before = self.made.get((design, kind, drawn), 0)
        self.made[design, kind, drawn] = max(n, before)
        self.spent.add(Spent(max(n - before, 0) * (STARTS if kind == FULL else 1), 0))
        return x

    def realizations(self, design: Design, kind: str, n: int) -> np.ndarray:
        """Estimates of realizations."""
        return self._made(design, kind, n, drawn=False)

    def draws(self, design: Design, kind: str, n: int) -> np.ndarray:
        """Estimates of a control for other draws of the data."""
        return self._made(design, kind, n, drawn=True)

    def cost(self, kind: str) -> float:
        """Evaluations behind one estimate."""
        return {FULL: 2500.0, TRUTH: 50.0, LINEARISED: 450.0}[kind]

    def simulation(self, cycles: int) -> float:
        """Evaluations that a record costs."""
        return 80.0 * cycles


def searched(
    fitter: KnownEstimator, limit: str, precision: float = 0.1, high: float = 16.0, budget: int = 500_000
) -> Arm:
    """The arm after a search over the amplitude at 6 cycles."""
    space = Space((6, 6), (2.0, high), (1.2,), None, ("amplitude",), 43.72, 1)
    arm = Arm(1.2, space, parse_targets(MODEL, [f"cv(K12) <= {limit}"]), fitter, 50)  # type: ignore[arg-type]
    search([arm], Rules(precision, budget))
    return arm


def test_intervals_hold_the_answer_of_a_flat_measure_that_few_fits_decide() -> None:
    """Other fits end in the other minimum at every amplitude, so a prediction from few draws goes up and down."""
    holds = 0
    for seed in range(SEARCHES):
        fitter = KnownEstimator(seed, rarely, anew=True)
        limit = round(fitter.cv(8.0 * np.sqrt(5)), 4)
        exact = brentq(lambda a, f=fitter, c=limit: f.cv(a * np.sqrt(5)) - c, 2.0, 16.0)
        arm = searched(fitter, f"{100 * limit:g}%")
        low, _, high = arm.crossing("amplitude", arm.cheapest())
        holds += np.nan_to_num(low, nan=2.0) <= exact <= np.nan_to_num(high, nan=16.0)
    assert holds >= SEARCHES - 3


def never(signal: float) -> float:
    """No other minimum."""
    del signal
    return 0.0


def rarely(signal: float) -> float:
    """A small chance of another minimum, the same everywhere."""
    del signal
    return 0.02


def falling(signal: float) -> float:
    """A chance of another minimum that is constant and then falls steeply, as up to 8 Hz."""
    return float(0.25 / (1 + np.exp(8 * np.log(signal / 24.0))))


@pytest.mark.parametrize(("power", "far"), [(1.0, rarely), (0.5, never)])
def test_intervals_hold_the_true_answer_as_often_as_they_say(power: float, far: Callable[[float], float]) -> None:
    holds, apart = 0, []
    limit = round(KnownEstimator(0, far, power=power).cv(5.3 * np.sqrt(5)), 3)
    for seed in range(SEARCHES):
        fitter = KnownEstimator(seed, far, power=power)
        exact = brentq(lambda a, f=fitter: f.cv(a * np.sqrt(5)) - limit, 2.0, 16.0)
        arm = searched(fitter, f"{100 * limit:g}%")
        found = arm.cheapest()
        low, middle, high = arm.crossing("amplitude", found)
        holds += low <= exact <= high
        apart.append(np.log(middle / exact))
        assert width(arm, found).relative <= 0.1
    assert holds >= SEARCHES - 3  # with 95 % each, more than 3 of 12 fail with a chance of 0.2 %
    assert abs(np.mean(apart)) < 3 * np.std(apart) / np.sqrt(SEARCHES) + 0.01


def test_a_target_beyond_where_other_minima_vanish_is_found() -> None:
    """Fits from the true values do not see them, so what these predict is far from what complete fits do."""
    fitter = KnownEstimator(3, falling, level=0.5)
    assert fitter.cv(5 * np.sqrt(5)) > 0.3
    exact = brentq(lambda a: fitter.cv(a * np.sqrt(5)) - 0.2, 5.0, 16.0)
    arm = searched(fitter, "20%", 0.05)
    found = arm.cheapest()
    low, _, high = arm.crossing("amplitude", found)
    assert found.reached
    assert low <= exact <= high
    assert not arm.hopeless


def test_a_target_is_called_out_of_reach_only_if_every_design_is() -> None:
    arm = searched(KnownEstimator(4, falling, level=0.5), "20%", high=8.0)
    assert arm.hopeless
    assert not arm.cheapest().reached
    assert arm.cheapest(2).excess > 0


def test_a_measure_that_hardly_depends_on_the_axis_ends_the_search_when_it_is_known() -> None:
    fitter = KnownEstimator(5, rarely, level=0.4, power=0.03)
    limit = fitter.cv(6 * np.sqrt(5))
    arm = searched(fitter, f"{100 * limit:.2f}%", 0.05)
    known = width(arm, arm.cheapest())
    assert known.flat
    assert known.axis > 0.3
    assert known.measure <= 0.05
    assert fitter.spent.fits < 50_000


def test_a_search_ends_at_the_precision_of_the_axis_or_of_the_measure_whichever_comes_first() -> None:
    """Both are one demand where the measure is inversely proportional to the axis."""
    for power in (1.6, 1.0, 0.5):
        fitter = KnownEstimator(7, never, power=power)
        arm = searched(fitter, f"{100 * fitter.cv(5 * np.sqrt(5)):.3g}%", 0.05)
        known = width(arm, arm.cheapest())
        assert known.axis <= 0.05 or (known.flat and known.measure <= 0.05)
        assert known.measure / known.axis == pytest.approx(power, rel=0.25)


def test_no_more_fits_are_made_than_the_budget_allows() -> None:
    """Draws of the control count, of which a look may need many more than of complete fits."""
    for budget in (9 * 128 + 64 * (STARTS + 3), 6_000, 10_000, 20_000, 40_000):
        fitter = KnownEstimator(9, rarely)
        arm = searched(fitter, "15%", precision=0.005, budget=budget)
        assert width(arm, arm.cheapest()).relative > 0.005
        assert budget / 2 < fitter.spent.fits <= budget


def test_a_look_far_away_narrows_a_flat_crossing_for_fewer_fits() -> None:
    """The interval of Td1 up to 1.2 Hz is decided by the slope: the search does not repeat the look at the answer."""
    arm = searched(KnownEstimator(6, rarely, level=0.5, power=0.3), "24%", 0.05)
    assert len({look.design for look in arm.looks}) >= 2
    assert max(look.realizations for look in arm.looks) < 1000


def test_the_expected_errors_of_a_look_are_those_that_it_has() -> None:
    rng = np.random.default_rng(8)
    x, c, sample = rng.normal(1, 0.2, 800), rng.normal(1, 0.2, 800), rng.normal(1, 0.2, 4000)
    cv = MEASURES["cv"]
    small = estimated(Draws(x[:200], 1.0, c[:200], sample[:1000]), cv)
    large = estimated(Draws(x, 1.0, c, sample), cv)
    expected = small.with_draws(800, 4000)
    assert expected.error == pytest.approx(large.error, rel=0.1)
    assert expected.own[:200] @ large.own[:200] == pytest.approx(large.own[:200] @ large.own[:200], rel=0.1)
    apart = small.with_draws(800, 4000, 0.5)
    assert apart.error == pytest.approx(expected.error)
    assert apart.own[:200] @ large.own[:200] == pytest.approx(expected.own[:200] @ large.own[:200] / 2, rel=0.1)
