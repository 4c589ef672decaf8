"""The outcome of a fit of one person in several conditions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mcstudy.files import schema
from mcstudy.files.json_files import named, plain
from mcstudy.identification.conditions.sharing import Sharing
from mcstudy.identification.estimate import Estimate
from mcstudy.identification.fit_record import FitRecord
from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import copies


@dataclass(frozen=True, repr=False)
class ConditionsRecord:
    """Parameters of one person in several conditions.

    Attributes
    ----------
    fit
        The fit of all conditions (`FitRecord`). A parameter with a value in each condition is there once for each,
        under its name and that of the condition: ``Wp_small``.
    conditions
        Names of the conditions.
    separate
        Parameters with a value in each condition.
    sharings
        What the recordings say of the sharing of each parameter (`Sharing`).
    shared_model
        The model in which all parameters are shared.
    """

    fit: FitRecord
    conditions: tuple[str, ...]
    separate: tuple[str, ...]
    sharings: tuple[Sharing, ...]
    shared_model: Model

    def __getitem__(self, name: str | tuple[str, str]) -> Estimate:
        """Estimate of a quantity, ``result["tau"]``, or of one in a condition, ``result["Wp", "small"]``."""
        if isinstance(name, str):
            return self.fit[name]
        parameter, condition = name
        if condition not in self.conditions:
            raise KeyError(f"{condition!r}; expected one of {', '.join(self.conditions)}")
        known = copies(self.shared_model, self.separate).get(parameter, {})
        return self.fit[known.get(self.conditions.index(condition), parameter)]

    def sharing(self, name: str) -> Sharing:
        """What the recordings say of the sharing of one parameter."""
        for s in self.sharings:
            if s.name == name:
                return s
        raise KeyError(f"{name!r}; expected one of {', '.join(s.name for s in self.sharings)}")

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON data, valid under ``results_schema/1.0.0/conditions.json``."""
        document: dict[str, Any] = plain(
            {
                "schema": schema.identifier("conditions"),
                "conditions": self.conditions,
                "separate": self.separate,
                "sharing": [
                    named(
                        s,
                        *("name", "unit", "separate", "conditions", "values", "half_widths"),
                        *("ratio", "p_value", "unseen", "unseen_se"),
                    )
                    for s in self.sharings
                ],
            }
        )
        return {**document, "fit": self.fit.to_dict()}
