"""Simulate one case: the recording and its entry in the key."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcstudy.effect_library import library
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.errors import DesignError, InputError
from mcstudy.gap.candidates.signatures import alike_groups, similarity
from mcstudy.recordings.recording import Recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model
from mcstudy.streams import stream
from mcstudy_challenge.bodies.draws import draw_body, draw_linear, pool, protocol_of, shared
from mcstudy_challenge.bodies.foreign_recordings import draw_foreign, foreign_pool, simulate_foreign
from mcstudy_challenge.bodies.forms import FORMS, Form
from mcstudy_challenge.bodies.geometry import SIMILAR, Column, Geometry, Probe, best_fit, free
from mcstudy_challenge.bodies.other_forms import draw_form
from mcstudy_challenge.bodies.out_of_library import OUT_OF_LIBRARY
from mcstudy_challenge.bodies.stability_margin import draw_near_unstable
from mcstudy_challenge.bodies.withheld_causes import Drawn, draw_nonlinear, draw_out_of_library
from mcstudy_challenge.cases import Case
from mcstudy_challenge.design import NOTHING_MISSING, ChallengeFile, Series
from mcstudy_challenge.scores.oracle import Ceiling, Classifier, size_grid

REDRAWS = 40
"""Number of effects drawn for one case before the challenge is refused as impossible."""


@dataclass(frozen=True)
class Surroundings:
    """The space of one body with the signatures of all detectable effects."""

    geometry: Geometry
    columns: list[Column]
    names: list[str]
    cosine: np.ndarray
    groups: list[list[str]]

    @classmethod
    def of(cls, geometry: Geometry, probes: Sequence[Probe], extra: Sequence[Column] = ()) -> Surroundings:
        """Signatures of the probes on this body, and more."""
        columns = [*geometry.columns(probes), *extra]
        names, cosine = similarity([c.effect for c in columns], np.array([c.unit for c in columns]))
        return cls(geometry, columns, names, cosine, [list(g) for g in alike_groups(names, cosine)])

    def group(self, effect: str) -> list[str]:
        """The ambiguity group of an effect, itself included."""
        return next((g for g in self.groups if effect in g), [effect])

    def similar_to(self, effect: str) -> list[str]:
        """Effects with |cosine| above `SIMILAR`, itself included."""
        if effect not in self.names:
            return [effect]
        near = self.cosine[self.names.index(effect)] > SIMILAR
        return [n for n, close in zip(self.names, near, strict=True) if close or n == effect]


def make_case(file: ChallengeFile, case: Case) -> tuple[Recording, dict[str, Any]]:
    """The recording of a case and its entry in the key.

    Raises `DesignError` when no body of the series is stable with any effect drawn.
    """
    series = file.series[case.series]
    coordinates = (file.challenge.seed, f"challenge {case.series}", case.number)
    rng = stream(*coordinates)
    entry: dict[str, Any] = {"name": case.name, "series": case.series, "kind": case.kind}
    if case.kind in NOTHING_MISSING:
        near = case.kind == "near_unstable"
        theta = draw_near_unstable(series, rng) if near else draw_body(series, rng, case.kind == "shifted")
        recording, more = _nothing(series, rng, theta, simulate_foreign if case.kind == "foreign" else _own)
    elif case.kind == "outsider":
        recording, more = _out_of_library(series, rng)
    elif case.kind == "misshapen":
        recording, more = _misshapen(series, rng)
    elif case.kind in ("foreign_mechanism", "foreign_outsider"):
        recording, more = _foreign(series, rng, case.kind == "foreign_outsider")
    else:
        recording, more = _known(series, rng, 2 if case.kind == "pair" else 1)
    # The recording must not reveal how it was simulated.
    plain = Recording(
        recording.trials,
        recording.rate_hz,
        recording.period_s,
        recording.stimulus,
        recording.body,
        recording.convention,
        case.name,
        f"challenge {file.challenge.name}",
    )
    return plain, entry | more


def _entry(theta: np.ndarray, delta: float, effects: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    names = two_segment().names
    return {
        "parameters": dict(zip(names, (float(v) for v in theta), strict=True)),
        "delta": float(delta),
        "effects": effects,
        **more,
    }


def _own(protocol: Protocol, theta: np.ndarray, rng: np.random.Generator) -> Recording:
    return simulate_recording(protocol, theta, rng)


def _nothing(
    series: Series,
    rng: np.random.Generator,
    theta: np.ndarray,
    simulate: Callable[[Protocol, np.ndarray, np.random.Generator], Recording],
) -> tuple[Recording, dict[str, Any]]:
    if sum(series.mix.of(k) for k in NOTHING_MISSING) == 1.0:  # no case has a cause
        return simulate(protocol_of(series), theta, rng), _entry(theta, 0.0, [])
    setting, probes = shared(series)
    around = Surroundings.of(Geometry(free(two_segment()), theta, setting, series.noise.sensor), probes)
    ideal = classifier(series, around).ceiling(rng, None, 0.0).rounded() if around.columns else {}
    return simulate(protocol_of(series), theta, rng), _entry(theta, 0.0, [], ceiling=ideal)


def _known(series: Series, rng: np.random.Generator, number: int) -> tuple[Recording, dict[str, Any]]:
    drawable = pool(series)
    for _ in range(REDRAWS):
        names = sorted(rng.choice(drawable, number, replace=False).tolist())
        if len({library.effect(n).cause for n in names}) < number:
            continue
        if all(library.effect(n).kind == "linear" for n in names):
            done = _linear(series, rng, names)
        else:
            done = _ruled(series, rng, names[0]) if number == 1 else None
        if done is not None:
            return done
    raise DesignError(f"sizes: in {REDRAWS} draws, no effect of the required size was found with a stable body")


def _linear(series: Series, rng: np.random.Generator, names: list[str]) -> tuple[Recording, dict[str, Any]] | None:
    truth = draw_linear(series, rng, names)
    if truth is None:
        return None
    setting, probes = shared(series)
    geometry = Geometry(free(two_segment()), truth.theta, setting, series.noise.sensor)
    y = geometry.response(names, truth.sizes, 0.0)
    if y is None:
        raise DesignError(f"effects {', '.join(names)}: unstable after they were drawn")
    own, described = [], []
    for name in names:
        sizes = {s.name: truth.sizes[s.name] for s in library.effect(name).sizes}
        alone = geometry.response([name], sizes, 0.0)
        if alone is None:
            return None
        x = geometry.unexplained(alone)
        own.append(Column(Probe(name, sizes), x / np.linalg.norm(x), float(np.linalg.norm(x))))
        described.append({"effect": name, "sizes": sizes, "delta": own[-1].delta})
    around = Surroundings.of(geometry, probes, own)
    if len(names) == 2 and names[1] in around.group(names[0]):
        return None
    delta = float(np.linalg.norm(geometry.unexplained(y)))
    more = _explained(geometry, probes, y) | _similarity(around, described)
    if len(names) == 1:
        column = len(around.columns) - 1
        similar = [i for i, g in enumerate(around.groups) if set(g) & set(around.similar_to(names[0]))]
        more["ceiling"] = classifier(series, around).ceiling(rng, column, delta, similar).rounded()
    else:
        more["closable"]["+".join(names)] = 1.0
        more["ceiling"] = {"known_direction": Ceiling.power(delta)}
    recording = simulate_recording(protocol_of(series), truth.theta, rng, effects=names, sizes=truth.sizes)
    return recording, _entry(truth.theta, delta, described, **more)


def _ruled(series: Series, rng: np.random.Generator, name: str) -> tuple[Recording, dict[str, Any]] | None:
    drawn = draw_nonlinear(series, rng, name)
    if drawn is None:
        return None
    done = _simulated(series, rng, drawn)
    if done is None:
        return None
    recording, more = done
    group = [name, *same_change(name)]
    described = [{"effect": name, "sizes": drawn.sizes, "delta": drawn.measured.delta, "group": group, "kin": group}]
    more["closable"][name] = 1.0
    return recording, _entry(drawn.theta, drawn.measured.delta, described, **more)


def _out_of_library(series: Series, rng: np.random.Generator) -> tuple[Recording, dict[str, Any]]:
    names = series.sizes.outsiders or tuple(OUT_OF_LIBRARY)
    for _ in range(REDRAWS):
        name = str(rng.choice(names))
        drawn = draw_out_of_library(series, rng, name)
        done = None if drawn is None else _simulated(series, rng, drawn)
        if drawn is not None and done is not None:
            recording, more = done
            outside = {"name": name, "size": drawn.measured.size, "unit": OUT_OF_LIBRARY[name].unit}
            return recording, _entry(drawn.theta, drawn.measured.delta, [], outsider=outside, **more)
    raise DesignError(f"sizes.outsiders: in {REDRAWS} draws, none of the required size was found with a stable body")


def _misshapen(series: Series, rng: np.random.Generator) -> tuple[Recording, dict[str, Any]]:
    """One mechanism of the library in another form: every mechanism equally often, then every form of it.

    Similar effects are those of the declared effect, not of the form, so that a form that resembles another effect is
    no reason to accept the name of that effect.
    """
    forms = [f for n, f in FORMS.items() if (not series.sizes.forms or n in series.sizes.forms) and _shows(series, f)]
    mechanisms = sorted({f.mechanism for f in forms})
    for _ in range(REDRAWS if forms else 0):
        mechanism = str(rng.choice(mechanisms))
        own = [f for f in forms if f.mechanism == mechanism]
        form = own[int(rng.integers(len(own)))]
        drawn = draw_form(series, rng, form)
        done = None if drawn is None else _simulated(series, rng, drawn)
        if drawn is not None and done is not None:
            return done[0], _other_form(series, drawn, mechanism, form.name, done[1])
    raise DesignError(f"sizes.forms: in {REDRAWS} draws, none of the required size was found with a stable body")


def _other_form(series: Series, drawn: Drawn, mechanism: str, form: str, more: dict[str, Any]) -> dict[str, Any]:
    """Entry of the key for a mechanism in another form than the library declares."""
    around = Surroundings.of(drawn.geometry, shared(series)[1])
    delta = drawn.measured.delta
    described: list[dict[str, Any]] = [{"effect": mechanism, "sizes": drawn.sizes, "delta": delta}]
    more = more | _similarity(around, described)
    described[0]["group"] = [*described[0]["group"], *same_change(mechanism)]
    return _entry(drawn.theta, delta, described, form=form, **more)


def _foreign(series: Series, rng: np.random.Generator, outside: bool) -> tuple[Recording, dict[str, Any]]:
    """A foreign body with one mechanism of the library in roughly its form, or with a cause outside the library."""
    pool = foreign_pool(series, outside)
    for _ in range(REDRAWS if pool else 0):
        effect = pool[int(rng.integers(len(pool)))]
        drawn = draw_foreign(series, rng, effect)
        done = None if drawn is None else _simulated(series, rng, drawn)
        if drawn is not None and done is not None:
            recording, more = done
            if not outside:
                return recording, _other_form(series, drawn, effect.mechanism, effect.name, more)
            cause = {"name": effect.name, "size": drawn.measured.size, "unit": effect.unit}
            return recording, _entry(drawn.theta, drawn.measured.delta, [], outsider=cause, **more)
    raise DesignError(f"sizes.foreign: in {REDRAWS} draws, none of the required size was found with a stable body")


def same_change(name: str) -> list[str]:
    """Other effects that change the gains in the same direction, with amplitude or over time: two amplitudes, or first
    and last cycles, tell nothing else about them."""
    own = library.effect(name)
    if own.contrast is None:
        return []
    alike = (e for e in library.LIBRARY.values() if (e.contrast, e.gain_sign) == (own.contrast, own.gain_sign))
    return [e.name for e in alike if e.name != name]


def _shows(series: Series, form: Form) -> bool:
    """Whether a change with amplitude, if that is what the form makes, can appear in the recordings of a series."""
    several = len(set(series.protocol.amplitudes)) > 1
    return several or library.effect(form.mechanism).contrast != "amplitude"


def _simulated(series: Series, rng: np.random.Generator, drawn: Drawn) -> tuple[Recording, dict[str, Any]] | None:
    """None when the body is stable without noise but falls with noise."""
    try:
        recording = drawn.simulate(protocol_of(series), rng)
    except InputError:
        return None
    probes = shared(series)[1]
    m = drawn.measured
    more = _explained(drawn.geometry, probes, m.response)
    ceiling = {
        "known_direction": Ceiling.power(m.delta),
        "detected": Ceiling.omnibus(m.delta, drawn.geometry.smooth_dof),
    }
    if "any_form" in more:
        dof = drawn.geometry.smooth_dof
        ceiling["flagged"] = Ceiling.omnibus(more["smooth_residual"], dof)
        ceiling["flagged_any_form"] = Ceiling.omnibus(more["any_form"]["smooth_residual"], dof)
    more |= {"ceiling": {k: round(v, 4) for k, v in ceiling.items()}, "total_delta": round(m.total, 4)}
    return recording, more


LEAST_GAP = 1.0
"""Delta of the mean response below which shares of the gap have no meaning (for example for a drift)."""


def _explained(geometry: Geometry, probes: Sequence[Probe], y: np.ndarray) -> dict[str, Any]:
    """Share of the gap in noise-free mean FRFs that each effect of the library closes, the best one, and the rest; the
    same where the shape constants of the effects are free."""
    gap = float(np.linalg.norm(geometry.unexplained(y)))
    if gap < LEAST_GAP or not probes:  # a series may draw from nonlinear effects alone
        return {"closable": {}}
    declared: dict[str, tuple[float, np.ndarray]] = {}
    any_form: dict[str, tuple[float, np.ndarray]] = {}
    for name in dict.fromkeys(p.effect for p in probes):
        effect = library.effect(name)
        starts = [[s.parameter.value for s in effect.sizes]]
        starts += [[p.sizes[s.name] for s in effect.sizes] for p in probes if p.effect == name]
        at = np.array([[*geometry.theta, *s] for s in starts])
        declared[name] = any_form[name] = _left(geometry, y, library.apply(geometry.base, name), at)
        if effect.forms:
            opened = np.array([[*x, *c] for x in at for c in effect.corner_forms])
            other = _left(geometry, y, library.apply(geometry.base, name, opened=[name]), opened)
            any_form[name] = min(any_form[name], other, key=lambda done: done[0])
    return {**_nearest(geometry, gap, declared), "any_form": _nearest(geometry, gap, any_form)}


def _left(geometry: Geometry, y: np.ndarray, model: Model, starts: np.ndarray) -> tuple[float, np.ndarray]:
    """What the best fit of a model to noise-free FRFs leaves: noncentrality, and whitened residual (4 N,)."""
    noncentrality, fitted = best_fit(model, starts, geometry.setting.f, y, geometry.C)
    return noncentrality, geometry.whiten(y - fitted)


def _nearest(geometry: Geometry, gap: float, left: Mapping[str, tuple[float, np.ndarray]]) -> dict[str, Any]:
    """Part of an entry: what every effect closes of a gap of delta ``gap``, the one that closes most, and the rest."""
    closable = {n: round(float(np.clip(1 - x / gap**2, 0.0, 1.0)), 5) for n, (x, _) in left.items()}
    nearest = min(left, key=lambda n: left[n][0])
    rest = left[nearest][1]
    return {
        "closable": closable,
        "nearest": nearest,
        "residual_delta": round(float(np.linalg.norm(rest)), 4),
        "smooth_residual": round(geometry.smooth_delta(rest), 4),
    }


def _similarity(around: Surroundings, described: list[dict[str, Any]]) -> dict[str, Any]:
    for d in described:
        d["group"], d["kin"] = around.group(d["effect"]), around.similar_to(d["effect"])
    return {"groups": [g for g in around.groups if len(g) > 1]}


def classifier(series: Series, around: Surroundings) -> Classifier:
    """The ideal classifier of this body, with the shares of the challenge as prior."""
    S = np.column_stack([c.unit for c in around.columns])
    owner = np.array([next(i for i, g in enumerate(around.groups) if c.effect in g) for c in around.columns])
    each = np.array([sum(c.effect == other.effect for other in around.columns) for c in around.columns])
    # Every effect is drawn equally often, so the weight of a group is its number of effects.
    weight = 1.0 / each
    total = np.array([weight[owner == g].sum() for g in range(len(around.groups))])
    nothing = sum(series.mix.of(k) for k in NOTHING_MISSING)
    known = series.mix.known or 1.0
    prior = np.concatenate([[nothing or 1.0], known * total / total.sum()])
    delta, share = size_grid(series.sizes.strata)
    return Classifier(S.T @ S, owner, prior / prior.sum(), weight / total[owner], delta, share)
