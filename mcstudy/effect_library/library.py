"""The library of effects that a model may lack, and functions that add them to a model.

`LIBRARY` maps names to effects and starts with those of `mcstudy.effect_library.declarations`, which attach to a model
whose rows and angles have the names of the standing body's. `Library.register` adds a user's effect, which the whole
diagnosis then treats like the others. `library_of` is that library, or the effects that are generated for any other
declared model (`mcstudy.effect_library.generic`). `apply` adds any of them, or any pair, to the model.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any

from mcstudy.effect_library.constants import with_constants
from mcstudy.effect_library.declarations import DECLARATIONS
from mcstudy.effect_library.effect import LOCATIONS, Effect, Size, TrialSetting
from mcstudy.effect_library.generic import generic_effects, own_angles
from mcstudy.errors import InputError
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model, Parameter
from mcstudy.stance.joint import changed, members
from mcstudy.stance.rules import Rules
from mcstudy.text_tables import fill, similar


class Library(Mapping[str, Effect]):
    """Effects by name, in the order in which they are listed: a read-only mapping that `register` adds to."""

    def __init__(self, effects: Iterable[Effect]) -> None:
        self._effects: dict[str, Effect] = {}
        for e in effects:
            self.register(e)

    def __getitem__(self, name: str) -> Effect:
        return self._effects[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    def __repr__(self) -> str:
        return f"<Library of {len(self)} effects: {', '.join(self)}>"

    @property
    def linear(self) -> tuple[str, ...]:
        """Names of the linear effects, which the closed form includes."""
        return tuple(e.name for e in self.values() if e.kind == "linear")

    def register(self, effect: Effect) -> None:
        """Add an effect; every simulation and diagnosis of this process then knows it.

        Parameters
        ----------
        effect
            Its declaration, `mcstudy.Effect`.

        Raises
        ------
        InputError
            Its name, or the name of one of its parameters, is already used.
        """
        if effect.name in self._effects:
            raise InputError(f"effect {effect.name!r}: the library already has one of this name")
        taken = {name: e.name for e in self.values() for name in (*e.parameters, *e.nominal_form)}
        for name in (*effect.parameters, *effect.nominal_form):
            if name in taken:
                raise InputError(f"effect {effect.name!r}: parameter {name!r} is already that of {taken[name]}")
        self._effects[effect.name] = effect

    @property
    def sizes(self) -> dict[str, Size]:
        """Every parameter that an effect adds, by name."""
        return {s.name: s for e in self.values() for s in e.sizes}

    @property
    def shape_parameters(self) -> set[str]:
        """Names of the parameters that shape an effect without being its size."""
        return {s.name for s in self.sizes.values() if s.is_shape} | {f.name for e in self.values() for f in e.forms}

    def usual_size(self, parameter: str) -> tuple[float, float] | None:
        """The usual magnitude of a parameter that an effect adds, or of a shape constant; None for any other name."""
        ranges = {name: s.published for name, s in self.sizes.items()}
        ranges |= {f.name: (f.low, f.high) for e in self.values() for f in e.forms}
        return ranges.get(parameter)

    def words(self, name: str) -> str:
        """What an effect is called in a sentence; its name for one that has no words, or is not known."""
        words = self[name].words if name in self else ""
        return f"{words} [{name}]" if words else name

    @contextlib.contextmanager
    def extended(self, *effects: Effect) -> Iterator[None]:
        """Context manager: the library has more effects inside the ``with`` block, and is as before after it."""
        before = dict(self._effects)
        try:
            for e in effects:
                self.register(e)
            yield
        finally:
            self._effects = before


LIBRARY = Library(DECLARATIONS)
"""All effects that the program knows."""


def effect(name: str, library: Library = LIBRARY) -> Effect:
    """One declaration; raises `InputError` on a name that is not in the ``library``."""
    try:
        return library[name]
    except KeyError:
        near = similar(name, library)
        raise InputError(f"unknown effect {name!r}{near}; the library has {', '.join(library)}") from None


def library_of(model: Model) -> Library:
    """The effects that a ``model`` without effects may lack: `LIBRARY` for a standing body.

    For any other declared model those that are generated for it, and those that were registered.
    """
    return LIBRARY if standing(model) else _generated(model, tuple(LIBRARY.values()))


@lru_cache(maxsize=64)
def _generated(model: Model, known: tuple[Effect, ...]) -> Library:
    generic = generic_effects(members(model)[0] if any(b.lines is not None for b in model.blocks) else model)
    taken = {name for e in (*DECLARATIONS, *generic) for name in (e.name, *e.parameters, *e.nominal_form)}
    registered = (e for e in known if not {e.name, *e.parameters, *e.nominal_form} & taken)
    return Library([*generic, *registered])


def places(model: Model) -> tuple[str, ...]:
    """Where effects on a model may act."""
    return LOCATIONS if standing(model) else (*own_angles(model), "stimulus", "sensor")


def apply(model: Model, *names: str, opened: Iterable[str] = ()) -> Model:
    """The model with the named linear effects; the order of the names matters only for that of the parameters.

    The shape constants (`mcstudy.effect_library.effect.Form`) of the effects in ``opened`` are parameters too, after
    the sizes of their effect; those of all others have the value of the declared form.

    Raises `InputError` for an unknown, repeated or nonlinear effect (see `trace`), `ModelError` when the model lacks
    the row an effect acts on.
    """
    if not names:
        return model
    library = library_of(model)
    effects = tuple(effect(n, library) for n in names)
    for e in effects:
        if e.kind != "linear":
            raise InputError(f"effect {e.name!r} is {e.kind}: it has no closed form, only the approximation of `trace`")
    shaped = set(opened)
    return _applied(model, model.provenance, effects, tuple(n for n in names if n in shaped), tuple(library))


def trace(model: Model, name: str) -> Model:
    """Linear approximation of an effect that changes the active gains: all active feedback times (1 + gain).

    The added parameter, ``gain_<name>``, is free in one of two sets of data (amplitudes, first and last cycles) and
    zero in the other.
    """
    library = library_of(model)
    declared = effect(name, library)
    if declared.rule is None:
        raise InputError(f"effect {name!r} is linear: use `apply` instead")
    change = Size(
        name=f"gain_{name}",
        unit="",
        null=0.0,
        lower=-0.9,
        upper=2.0,
        published=(0.05, 0.4),
        meaning=f"change of active gains by {name}",
    )
    return _apply(model, [declared], [change.parameter], tuple(library))


def rules(effects: Iterable[Effect], sizes: Mapping[str, float], trial: TrialSetting) -> Rules:
    """The combined time-domain rules of effects; linear ones have none."""
    fields: dict[str, Any] = {}
    for rule in (e.rule for e in effects):
        if rule is not None:
            fields |= rule(sizes, trial)
    return Rules(**fields)


def _apply(model: Model, effects: list[Effect], added: Iterable[Parameter], listed: tuple[str, ...]) -> Model:
    added = list(added)
    given = {p.name for p in added}
    fixed = [f for e in effects for f in e.forms if f.name not in given]
    names = [e.name for e in effects]
    if len(set(names)) != len(names):
        raise InputError(f"effects {', '.join(names)}: each may be named once")
    named = "+".join((model.name, *sorted(names)))
    model = model.with_terms(parameters=[*added, *(f.parameter for f in fixed)], name=named)
    for declared in sorted(effects, key=lambda e: (e.order, listed.index(e.name))):
        model = changed(model, declared.build)
    return with_constants(model, {f.name: f.nominal for f in fixed})


@lru_cache(maxsize=128)
def _applied(
    model: Model, provenance: str, effects: tuple[Effect, ...], opened: tuple[str, ...], listed: tuple[str, ...]
) -> Model:
    """`_apply`, kept: a diagnosis asks for each of some eighty models several times.

    ``provenance``: of ``model``, in which equal models may differ. ``listed``: the library, whose order counts.
    """
    del provenance
    added = []
    for e in effects:
        added += [s.parameter for s in e.sizes]
        added += [f.parameter for f in e.forms if e.name in opened]
    return _apply(model, list(effects), added, listed)


def table_text(library: Library = LIBRARY) -> str:
    """A library as text for `mcstudy gap effects`.

    One block per effect: name, location, size with its usual range, equation, where that range comes from, and the
    shape constants that are open.
    """

    def lines(label: str, content: str) -> str:
        return fill(f"  {label}  {content}", " " * (len(label) + 4))

    return "\n\n".join(
        "\n".join(
            [
                f"{e.name}  ({', '.join(e.place)})",
                lines("size    ", f"{e.size.name}, {size_text(e.size)}: {e.size.meaning}"),
                lines("equation", e.equation),
                lines("source  ", e.source),
                *(
                    lines(
                        "form    ",
                        f"{f.name}, {f.nominal:g}, open from {f.low:g} to {f.high:g} {f.unit}".rstrip()
                        + f": {f.meaning} ({f.source})",
                    )
                    for f in e.forms
                ),
            ]
        )
        for e in library.values()
    )


def size_text(size: Size) -> str:
    """The usual range of a size with its unit."""
    low, high = size.published
    return f"{'±' if size.signed else ''}{low:.3g} to {high:.3g} {size.unit}".rstrip()
