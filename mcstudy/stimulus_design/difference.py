"""The distance of two models: how far the responses of one are from all that the other can give.

One effect of the library: the base model with it against the base model without. Two effects: the base model with one
against the base model with the other. A body with an effect responds differently from the same body without, but a
base model whose parameters are fitted again comes nearer, and only what is left shows. The *distance* is what is left,
in standard deviations of the best test for it: the root of the noncentrality.

The size of an effect is one at which a reference spectrum shows it with a distance near 6
(`mcstudy.gap.candidates.signatures`), because a distance at small sizes says nothing: the parameters absorb the
derivative of some effects. `Difference.distances` fits the model without the effect to noise-free responses with it.
For the criterion that is approximated to first order around the reference spectrum: what is left there is a further
column beside the derivatives J of the responses. With M the information of all columns together, the squared distance
of effect e from what J and the other effect can give is 1 / (M^-1)_ee: the criterion c of
`mcstudy.stimulus_design.criteria` for that column. T-optimality (Atkinson & Fedorov 1975, Biometrika 62:57-70).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.effect_library import library
from mcstudy.errors import InputError, ModelError
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.signatures import Signature, signatures
from mcstudy.lines.priors import opened, weak_prior
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

MOST = 2
"""Largest number of effects: each of two against the other."""

FAINT = 0.2
"""Distance at the reference below which no stimulus of this kind is taken to show an effect; two effects with equal
responses are apart by 0.13, because weak priors restrain the fits."""


@dataclass(frozen=True, eq=False)
class Difference:
    """Effects whose presence a design shall show, for one body with P parameters.

    Attributes
    ----------
    base: the model without effects, with wide bounds. effects: names of the E effects. sizes: of every effect, with its
    shape parameters. f: lines, Hz, (K,). whitener: of the errors at unit power, (K, 2, 2). responses: noise-free, with
    every effect, (E, K, 2). information: of every line at unit power for the parameters, relative to their true values,
    and for the effects, (K, P + E, P + E).
    """

    base: Model
    effects: tuple[str, ...]
    sizes: tuple[dict[str, float], ...]
    f: np.ndarray
    whitener: np.ndarray
    responses: np.ndarray
    information: np.ndarray

    @property
    def columns(self) -> np.ndarray:
        """W of the criterion: the effects, (P + E, E)."""
        return np.eye(self.information.shape[-1])[:, -len(self.effects) :]

    def distances(self, power: np.ndarray) -> np.ndarray:
        """Distance (E,) of every effect from the base model with the others, at lines with ``power`` (K,)."""
        used = power > 0
        weight = self.whitener[used] * np.sqrt(power[used])[:, None, None]
        out = []
        for name, y in zip(self.effects, self.responses, strict=True):
            model = library.apply(self.base, *(other for other in self.effects if other != name))
            fitter = Fitter(model, weak_prior(model, self.base), self.f[used])
            out.append(fitter.best(Data(self.f[used], y[used], weight), model.truth).chi2)
        return np.sqrt(out)


def difference(
    model: Model, effects: tuple[str, ...], f: np.ndarray, power: np.ndarray, whitener: np.ndarray
) -> Difference:
    """The difference that effects make for a body, seen from a reference spectrum.

    Parameters
    ----------
    model: of the body; its truth are the true values, none of them 0. effects: see `check_effects`. f: lines, Hz, (K,).
    power: of the reference spectrum there, (K,), all above 0. whitener: of the errors at unit power, (K, 2, 2).

    Raises
    ------
    InputError
        The model lacks what an effect acts on.
    """
    base = opened(model)
    drive = np.sqrt(power)[:, None, None]
    data = Data(f, frf(base, base.truth, f), whitener * drive)
    fitted = Fitter(base, weak_prior(base, base), f).best(data, base.truth)
    chosen = []
    for name in effects:
        try:
            chosen.append(_middle(signatures(fitted, data, [library.effect(name)]), name))
        except ModelError as error:
            raise InputError(f"design.effects: {name}: {error}") from None
    columns = np.column_stack([fitted.jacobian(data) * np.abs(model.truth), *(s.vector for s in chosen)])
    left = columns.reshape(2, f.size, -1, columns.shape[1])  # real and imaginary parts, lines, angles
    white = (left[0] + 1j * left[1])[..., -len(effects) :]
    responses = data.y + np.moveaxis(np.linalg.inv(whitener * drive) @ white, -1, 0)
    unit = left / drive
    information = np.einsum("cnip,cniq->npq", unit, unit)
    return Difference(base, effects, tuple(s.sizes for s in chosen), f, whitener, responses, information)


def require_shown(difference: Difference, power: np.ndarray, kind: str) -> None:
    """Raise `InputError`, one line, if the parameters, or one effect for the other, compensate all that is to be shown.

    ``power``: of the reference, (K,). ``kind``: of the stimulus.
    """
    if difference.distances(power).min() < FAINT:
        what = " and ".join(difference.effects)
        why = "cannot be told apart" if len(difference.effects) > 1 else "is compensated by the parameters of the model"
        raise InputError(f"design.effects: under {kind.replace('_', ' ')}, {what} {why}; choose another stimulus.kind")


def _middle(signatures: list[Signature], name: str) -> Signature:
    """That with a positive size and its shape parameters in the middle of their range."""
    size = library.effect(name).size.name
    positive = [s for s in signatures if s.sizes[size] > 0]
    return positive[len(positive) // 2]


def check_effects(names: tuple[str, ...]) -> None:
    """Raise `InputError`, one line, unless there are one or two linear effects of different causes."""
    if not 1 <= len(names) <= MOST:
        raise InputError(f"design.effects: expected one or two effects for criterion 'difference', got {len(names)}")
    for name in names:
        if name not in library.LIBRARY.linear:
            known = ", ".join(library.LIBRARY.linear)
            raise InputError(f"design.effects: expected linear effects ({known}), got {name!r}")
    if len({library.effect(name).cause for name in names}) < len(names):
        raise InputError(f"design.effects: expected effects of different causes, got {' and '.join(names)}")
