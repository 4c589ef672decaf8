"""The groups of a study that the paper's numbers are about."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from mcstudy.analysis.view import GroupView, StudyView


def comparable(view: GroupView, fmax: Iterable[float], amplitude: Iterable[float]) -> bool:
    """Whether the paper's numbers at these Fmax (Hz) and amplitudes (N m) apply to this group."""
    return (
        view.group.model.kind == "two_segment"
        and view.group.stimulus.kind == "ankle_torque"
        and view.group.fit.cost == "paper"
        and all(view.fmax(f) is not None for f in fmax)
        and all(view.amplitude(a) is not None for a in amplitude)
    )


def accuracy(study: StudyView, fmax: Sequence[float], amplitude: Sequence[float]) -> GroupView | None:
    """The comparable group with noise that is nearest to the paper's setting; of those, the most realizations."""
    fit = [g for g in study.groups.values() if g.noisy and comparable(g, fmax, amplitude)]
    return max(fit, key=lambda g: (-len(g.differences), g.group.realizations), default=None)


def pools(study: StudyView, fmax: float, amplitude: float, least: int) -> GroupView | None:
    """The comparable group with noise that is nearest to the paper's; of those, the most starts in every cell."""
    fit = [g for g in study.groups.values() if g.noisy and comparable(g, [fmax], [amplitude])]
    enough = [g for g in fit if g.group.starts >= least and not g.group.until_certain]
    return max(enough, key=lambda g: (-len(g.differences), g.group.starts), default=None)


def noise_free(study: StudyView, fmax: float, least: int) -> GroupView | None:
    """The comparable group fitted to the closed form that has the most pools of at least ``least`` starts."""
    fit = [g for g in study.groups.values() if g.group.simulator == "none" and comparable(g, [fmax], [])]
    enough = [g for g in fit if g.group.starts >= least and not g.group.until_certain]
    return max(enough, key=lambda g: (-len(g.differences), g.group.realizations), default=None)
