"""The independent-channel model, its torque an auxiliary unknown without inertia, against published and round values.

    (J s^2 - mgh + Kpas + Bpas s) theta = T + (Kpas + Bpas s) sigma
    T = NC D A (Wp (sigma - theta) + Wv (v - theta) - Wg theta + F T),  Wp + Wv + Wg = 1

with NC = Kp + Kd s + Ki / s, D a delay, A the activation and F = Kt / s or Kt / (Ft s + 1) (Peterka 2003; Pasma et al.
2017, Front Comput Neurosci 11:99). Responses were computed by another program from the closed form.
"""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.models.record import ModelTable
from mcstudy.stance.feedback import Filter, Model, Output, OutputTerm, Parameter, Term
from mcstudy.stance.response import frf, frf_jacobian

F = np.array([0.05, 0.15, 0.45, 0.85, 1.25, 2.45])

SETS = {
    "A": {"J": 90, "mgh": 755, "Kp": 1019.25, "Kd": 354.85, "tau": 0.151, "Kt": 1.38e-4, "Wp": 0.534, "Wv": 0.2},
    "B": {"J": 90, "mgh": 755, "Kp": 1057, "Kd": 302, "tau": 0.16, "Kt": 8.727e-5, "Ft": 20, "Wp": 0.45, "Wv": 0.45},
    "C": {"J": 81.1, "mgh": 732.2, "Kp": 967, "Kd": 344, "Ki": 86, "tau": 0.151, "Wp": 0.53, "Wv": 0.2},
}
SETS["D"] = {k: v for k, v in SETS["C"].items() if k != "Ki"} | {"Kpas": 91, "Bpas": 34, "Kt": 0.0018, "Ft": 16.5}
SETS["E"] = SETS["D"] | {"Kd": 300, "tau": 0.06, "w0": 16.8, "beta": 1}
SETS["F"] = {
    "J": 66, "mgh": 75 * 9.81 * 0.83, "Kpas": 40.5, "Bpas": 68.8, "w0": 16.8, "beta": 0.99, "tau": 0.097,
    "Wp": 0.8, "Wv": 0.8, "Kp": 943.9, "Kd": 313.5, "Kt": 0.0018, "Ft": 17.4,
}  # fmt: skip
"""kg m^2, N m/rad, N m s/rad, N m/(rad s), s, rad/(N m s) or rad/(N m), rad/s. F is Table 1 of Pasma et al. 2017; A has
an integrator in its torque feedback, C none."""

RESPONSES = """
A Wp .9146096+1.0336159i 2.2797363-.1275200i .2103594-1.8692275i
     -.7550400-.5068905i -.4745518+.0160713i -.0537859+.1355961i
A Wv .3425504+.3871221i .8538338-.0477603i .0787863-.7000852i
     -.2827865-.1898466i -.1777348+.0060192i -.0201445+.0507851i
B Wv 1.5870751-.1005956i 1.6683505-.5618137i -.4162592-1.7606287i
     -.5751955-.1881048i -.3077242+.0561383i -.0252790+.1017156i
C Wp 1.4576975+.8999891i 2.3595661-.9191168i .1655204-1.5124694i
     -.6572601-.6288320i -.5245185-.0417382i -.0616583+.1527302i
C Wv .5500745+.3396185i .8904023-.3468365i .0624605-.5707432i
     -.2480227-.2372951i -.1979315-.0157503i -.0232673+.0576341i
D Wp 1.3444780+.6857623i 1.8557266-.3541386i .7297160-1.4618664i
     -.5943712-.9276481i -.5674488-.1525018i -.0735409+.1194979i
D Wv .4487149+.1977837i .5939237-.1384733i .2015208-.4918751i
     -.2359357-.2837291i -.2053749-.0203264i -.0233272+.0558326i
E Wp 1.3028847+.7307752i 2.0538277-.1095151i .3257954-2.4742225i
     -.7159021-.3455460i -.3256735-.0034908i -.0371876+.0376638i
E Wv .4366821+.2115600i .6597516-.0688937i .0233980-.8085888i
     -.2556355-.0724539i -.1123534+.0262670i -.0112576+.0245784i
F Wp 1.763686+.666279i 2.243617-.190832i 2.030009-2.199293i
     -1.800654-.771314i -.562688+.161623i .007328+.064483i
F Wv 1.713794+.571434i 2.109592-.345634i 1.504146-2.340508i
     -1.871402-.275961i -.519157+.354792i .016091+.128675i
"""
"""Sway per tilt of the surface (Wp) or the visual scene (Wv) at `F`, to the digits printed."""


def independent_channel(values: dict[str, float], weight: str) -> Model:
    """The loop of a set under one tilt, whose sway is the only output."""
    skip = ("J", "mgh", "Wp" if weight == "Wv" else "Wv")
    parameters = tuple(Parameter(k, "", v, 0.0, 2.0 * v) for k, v in values.items() if k not in skip)
    activation = Filter("activation", "1", "1 + 2*beta*s/w0 + s**2/w0**2")
    memory = Filter("memory", "1", "1 + Ft*s")
    through = ("activation",) if "w0" in values else ()
    terms = [
        Term("body", "sway", order=2, coefficient=values["J"]),
        Term("body", "sway", coefficient=-values["mgh"]),
        Term("body", "torque", coefficient=-1.0),
        Term("muscle", "torque"),
    ]
    for passive, order in (("Kpas", 0), ("Bpas", 1)):
        if passive in values:
            terms.append(Term("body", "sway", passive, order))
            terms += [Term("body", "stimulus", passive, order)] * (weight == "Wp")
    for gain, order in (("Kp", 0), ("Kd", 1), ("Ki", -1)):
        if gain in values:
            terms.append(Term("muscle", "sway", gain, order, "tau", through, noisy=True))
            terms.append(Term("muscle", "stimulus", (gain, weight), order, "tau", through, noisy=True))
            if "Ft" in values:
                terms.append(Term("muscle", "torque", (gain, "Kt"), order, "tau", (*through, "memory"), -1.0))
            elif "Kt" in values:
                terms.append(Term("muscle", "torque", (gain, "Kt"), order - 1, "tau", through, -1.0))
    filters = (*([activation] if "w0" in values else []), *([memory] if "Ft" in values else []))
    return Model(
        "independent_channel", parameters, tuple(terms), filters, rows=("muscle", "body"), angles=("sway", "torque"),
        stimulus_unit="rad", outputs=(Output("theta", (OutputTerm("sway"),)),),
    )  # fmt: skip


@pytest.mark.parametrize("row", np.reshape(RESPONSES.split(), (-1, 8)).tolist(), ids=lambda row: "-".join(row[:2]))
def test_sway_is_that_of_the_closed_form(row: list[str]) -> None:
    name, weight, *numbers = row
    m = independent_channel(SETS[name], weight)
    expected = np.array([complex(x.replace("i", "j")) for x in numbers])
    assert (m.n_rows, m.output_names, m.output_units) == (2, ("theta",), ("rad",))
    H = frf(m, m.truth, F)
    assert H.shape == (6, 1)
    np.testing.assert_allclose(H[:, 0], expected, rtol=1e-6, atol=6e-8 if name != "F" else 6e-7)
    read = ModelTable.of(m).model()  # the same as a file says it
    np.testing.assert_array_equal(frf(read, read.truth, F), H)
    assert frf_jacobian(m, m.truth, F)[1].shape == (6, 1, len(m.parameters))
