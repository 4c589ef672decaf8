"""A model of your own: how well does one torque stimulus identify the reflex loop of an elbow?"""

import argparse

from mcstudy.analysis import accuracy, selection
from mcstudy.own_model import run_model
from mcstudy.stance.feedback import Model, Parameter, Term

INERTIA = 0.08  # forearm and hand about the elbow, kg m^2

elbow = Model(
    name="elbow",
    rows=("unused", "elbow"),  # a single joint uses the second row and the first angle
    angles=("flexion", "none"),
    parameters=(
        Parameter("K", "N m/rad", 10.0, 0.0, 20.0, "intrinsic stiffness"),
        Parameter("B", "N m s/rad", 0.6, 0.0, 1.2, "intrinsic viscosity"),
        Parameter("Kr", "N m/rad", 8.0, 0.0, 16.0, "reflex gain on angle"),
        Parameter("Br", "N m s/rad", 0.3, 0.0, 0.6, "reflex gain on rate"),
        Parameter("Td", "s", 0.040, 0.020, 0.060, "reflex delay"),
    ),
    terms=(
        Term("elbow", "flexion", order=2, coefficient=INERTIA),
        Term("elbow", "flexion", ("K",)),
        Term("elbow", "flexion", ("B",), order=1),
        Term("elbow", "flexion", ("Kr",), delay="Td", noisy=True),
        Term("elbow", "flexion", ("Br",), order=1, delay="Td", noisy=True),
        Term("elbow", "stimulus"),
    ),
)

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--realizations", type=int, default=50)
n = parser.parse_args().realizations
cube = run_model(elbow, realizations=n, starts=20, fmax=(1.2, 8.0), amplitude=(1.0,), noise={"psd": (4e-4, 0.0)})
percent = accuracy.absolute_bias_percent(selection.best(cube)).isel(amplitude=0)
print(percent[["value", "mcse", "floor"]].to_dataframe().round(2))
