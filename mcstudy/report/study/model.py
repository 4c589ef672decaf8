"""The model of the study: block diagram (Fig. 1B), equations, and every constant (Table I)."""

from __future__ import annotations

from dataclasses import fields

from mcstudy.report.html import Table, escape, table
from mcstudy.report.labels import with_units
from mcstudy.report.study.context import Context
from mcstudy.report.study.diagram import diagram
from mcstudy.report.study.equations import equations
from mcstudy.stance.body import KINDS, Body


def model_html(context: Context) -> str:
    """The model of the main group, or of the first one."""
    view = context.main
    model, declared = view.model, view.group.model.declared
    one = model.n_angles == 1
    angles = "θ1 is the angle of the body from upright"
    if not one:
        angles = "θ1 is the angle of the lower body from upright, θ2 the hip angle, θ2s = θ1 + θ2"
    stimulus = f"the stimulus, in {with_units(model.stimulus_unit)}"
    if declared:
        angles = f"{' and '.join(model.angles[: model.n_angles])} in {model.unit}"
        units = "times are in s, units of the parameters are those of the table"
    else:
        stimulus, units = KINDS[view.group.stimulus.kind].description, "units are N·m, kg, m, rad and s"
    text = (
        f"u is {stimulus}; {angles}. Active feedback is delayed and sees sensor noise; "
        f"passive feedback is neither delayed nor noisy. s is the Laplace variable; {units}."
    )
    heading = "Model and feedback" if one or declared else "Fig. 1B · Model and feedback"
    parameters = Table(
        "Parameters (estimated)" if declared else "Table I · Parameters (estimated)",
        ["parameter", "true value", "unit", "lower bound", "upper bound", "meaning"],
        [
            [p.name, f"{p.value:.4g}", with_units(p.unit), f"{p.lower:.4g}", f"{p.upper:.4g}", p.meaning]
            for p in model.parameters
        ],
    )
    constants = "" if declared else _constants(Body(**view.group.model.body))
    drawing = diagram(model, heading, "fig1-text")
    how = f"<code>mcstudy report OUT, after mcstudy run {escape(context.name)}.toml -o OUT</code>"
    return (
        f'<figure id="fig1" class="few" aria-labelledby="fig1-h"><h3 id="fig1-h">{heading}</h3>'
        f'<div class="panels"><div class="panel diagram scroll">{drawing}</div></div>'
        f'<figcaption><div id="fig1-text"><p>{escape(text)}</p></div><p class="how">Made by {how}</p></figcaption>'
        f'<div class="equations scroll">{equations(model)}</div></figure>'
        f'<div class="side">{table(parameters, "facts")}{constants}</div>'
        f"<p>Origin of the values: {escape(view.provenance)}. Starts are uniform between the bounds. Group "
        f"{escape(view.name)}; the study file at the end of the page holds the values of every group.</p>"
    )


def _constants(body: Body) -> str:
    rows = [[f.name, f"{getattr(body, f.name):.4g}", _readable(f.metadata["within"].unit)] for f in fields(Body)]
    return table(Table("Table I · Body (fixed)", ["constant", "value", "unit"], rows), "facts")


def _readable(unit: str) -> str:
    return with_units(unit).replace("^2", "²")
