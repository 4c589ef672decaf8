"""The paths of a closed loop, as its pictures and its equations show them: what acts on what, and through what."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

from mcstudy.report.labels import CONTROLLERS
from mcstudy.stance.feedback import Model, Term

_GREEK = {"theta": "θ"}


@dataclass(frozen=True)
class Path:
    """Feedback from one signal to one joint: the terms that share sense, delays and noise.

    ``tilt``: the share of a tilt u that is taken from the angle, the name of a weight or "1"; empty without a tilt.
    """

    row: str
    sense: str
    delays: tuple[str, ...]
    noisy: bool
    terms: tuple[Term, ...]
    tilt: str = ""

    @property
    def tilted(self) -> str:
        """What is taken from the angle, as text: ``W u``, ``u``, or nothing."""
        return f"{self.tilt} u".removeprefix("1 ") if self.tilt else ""

    @property
    def controller(self) -> str:
        """The paper's name of a neural controller, e.g. ``T12``; empty for passive feedback."""
        return CONTROLLERS.get((self.row, self.sense), "") if self.noisy else ""


@dataclass(frozen=True)
class Loop:
    """A model in parts.

    ``body``: terms without gain, delay, filter and noise. ``drives``: what the stimulus does outside the ``paths``.
    ``stimuli``: symbols of the stimuli, ``u`` or, of several, ``u`` with their names.
    """

    body: tuple[Term, ...]
    paths: tuple[Path, ...]
    drives: tuple[Term, ...]
    stimuli: tuple[str, ...]

    @classmethod
    def of(cls, model: Model) -> Loop:
        """The parts of a model, passive paths first. A tilt that feedback senses is part of its path."""
        drives = [t for t in model.terms if t.sense == "stimulus"]
        found: dict[tuple[str, str, tuple[str, ...], bool], list[Term]] = {}
        body = []
        for t in model.terms:
            if t.sense != "stimulus" and (t.gain or t.all_delays or t.filters or t.noisy):
                found.setdefault((t.row, t.sense, t.all_delays, t.noisy), []).append(t)
            elif t.sense != "stimulus":
                body.append(t)
        paths = [_with_tilt(Path(*key, tuple(terms)), drives) for key, terms in found.items()]
        paths.sort(key=lambda p: (p.noisy, -model.rows.index(p.row), p.sense))
        names = model.stimulus_names
        return cls(
            tuple(body), tuple(paths), tuple(drives), tuple(f"u{n}" for n in names) if len(names) > 1 else ("u",)
        )

    def rows(self, model: Model) -> list[str]:
        """The joints that have a balance, the lowest first."""
        return [r for r in reversed(model.rows) if any(t.row == r for t in model.terms)]


def _with_tilt(path: Path, drives: list[Term]) -> Path:
    """The path with the tilt that all its terms sense, which is taken from ``drives``."""
    pairs = []
    for t in path.terms:
        pairs.append(
            [
                d
                for d in drives
                if t.gain
                and replace(d, gain=t.gain, sense=t.sense, noisy=t.noisy) == t
                and d.gain[: len(t.gain)] == t.gain
            ]
        )
    shares = Counter(d.gain[len(t.gain) :] for t, found in zip(path.terms, pairs, strict=True) for d in found)
    share = next((s for s, n in shares.items() if n == len(path.terms)), None)
    if share is None:
        return path
    for t, found in zip(path.terms, pairs, strict=True):
        drives.remove(next(d for d in found if d.gain[len(t.gain) :] == share))
    return replace(path, tilt="".join(share) or "1")


def split(name: str) -> tuple[str, str]:
    """Letter and index of a symbol: theta2s is θ and 2s, Kpas1 is K and pas1."""
    for word, letter in _GREEK.items():
        if name.startswith(word):
            return letter, name[len(word) :]
    return name[:1], name[1:]


def is_symbol(name: str) -> bool:
    """Whether a signal has a symbol; others have a word."""
    return len(name) == 1 or any(name.startswith(word) for word in _GREEK)


def written(term: Term) -> str:
    """A term without its delays, as plain text: ``0.5 K tau s RC``; empty for 1."""
    power = {0: "", 1: "s", 2: "s²", -1: "1/s"}[term.order]
    factor = "" if term.coefficient == 1 else f"{term.coefficient:.4g}".replace("-", "−")
    return " ".join(part for part in (factor, *term.gain, power, *term.filters) if part)
