"""The model of the study: block diagram, equations, and every constant."""

from __future__ import annotations

from dataclasses import fields

from markupsafe import Markup

from mcstudy.analysis.publications.publication import ALONE, Counterpart
from mcstudy.report.html import html, table
from mcstudy.report.labels import with_units
from mcstudy.report.study.context import Context
from mcstudy.report.study.diagram import diagram
from mcstudy.report.study.equations import equations
from mcstudy.stance.body import KINDS, Body
from mcstudy.text_tables import Table


def model_html(context: Context) -> Markup:
    """The model of the main group, or of the first one."""
    view = context.main
    model, declared = view.model, view.group.model.declared
    counterparts = {} if declared else context.publication.counterparts
    single = model.n_outputs == 1
    angles = "θ1 is the angle of the body from upright"
    if not single:
        angles = "θ1 is the angle of the lower body from upright, θ2 the hip angle, θ2s = θ1 + θ2"
    stimulus = f"the stimulus, in {with_units(model.stimulus_unit)}"
    if declared:
        measured = " and ".join(f"{n} in {u}" for n, u in zip(model.output_names, model.output_units, strict=True))
        angles = f"measured {'is' if single else 'are'} {measured}"
        if len(model.blocks) > 1:
            stimulus = "each stimulus: " + ", ".join(f"{b.name} in {with_units(b.unit)}" for b in model.blocks)
        units = "times are in s, units of the parameters are those of the table"
    else:
        stimulus, units = KINDS[view.group.stimulus.kind].description, "units are N·m, kg, m, rad and s"
    text = (
        f"u is {stimulus}; {angles}. Active feedback is delayed and sees sensor noise; "
        f"passive feedback is neither delayed nor noisy. s is the Laplace variable; {units}."
    )
    heading = (ALONE if single else counterparts.get("diagram", ALONE)).heading("Model and feedback")
    parameters = Table(
        counterparts.get("parameters", ALONE).heading("Parameters (estimated)"),
        ["parameter", "true value", "unit", "lower bound", "upper bound", "meaning"],
        [
            [p.name, f"{p.value:.4g}", with_units(p.unit), f"{p.lower:.4g}", f"{p.upper:.4g}", p.meaning]
            for p in model.parameters
        ],
    )
    constants = Markup("") if declared else _constants(Body(**view.group.model.body), counterparts.get("body", ALONE))
    return html(
        '<figure id="diagram" class="few" aria-labelledby="diagram-h"><h3 id="diagram-h">{}</h3>'
        '<div class="panels"><div class="panel diagram scroll">{}</div></div>'
        '<figcaption><div id="diagram-text"><p>{}</p></div><p class="how">Made by <code>mcstudy report OUT, '
        "after mcstudy run {}.toml -o OUT</code></p></figcaption>"
        '<div class="equations scroll">{}</div></figure><div class="side">{}{}</div>'
        "<p>Origin of the values: {}. Starts are uniform between the bounds. Group {}; the study file at the end of "
        "the page holds the values of every group.</p>",
        heading,
        Markup(diagram(model, heading, "diagram-text")),
        text,
        context.name,
        Markup(equations(model)),
        table(parameters, "facts"),
        constants,
        view.provenance,
        view.name,
    )


def _constants(body: Body, counterpart: Counterpart) -> Markup:
    rows = [
        [f.name, f"{getattr(body, f.name):.4g}", with_units(f.metadata["within"].unit).replace("^2", "²")]
        for f in fields(body)
    ]
    return table(Table(counterpart.heading("Body (fixed)"), ["constant", "value", "unit"], rows), "facts")
