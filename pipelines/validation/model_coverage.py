"""How often do 95 % intervals of shipped models hold the truth? One study for each: mcstudy run STUDY; mcstudy show.

    python pipelines/validation/model_coverage.py two_mass_drive electrochemical_cell elbow

Runs the studies of shipped models (``pipelines/NAME.toml``) and prints for each parameter its truth, bias, coefficient
of variation and the coverage of ``estimate ± 1.96 SE`` at the largest Fmax and amplitude, with those of the derived
quantities beside, for which a study keeps no standard error.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import mcstudy as mc
from pipelines import measured

FOLDER = Path(__file__).parents[1]
HEADER = ("", "truth", "bias, %", "CV, %", "coverage of 95 %")


def rows(study: Path) -> list[list[str]]:
    """One row for each parameter and derived quantity of the study's last group."""
    with TemporaryDirectory() as folder:
        tree = mc.run(mc.read_study(study), Path(folder) / "cube.zarr")
        *_, group = tree.children.values()
        last = group.to_dataset().isel(amplitude=[-1], fmax=[-1]).load()
    cells, found = last.mc.best(), []
    coverage = last.mc.performance().isel(amplitude=0, fmax=0).sel(measure="coverage")
    for part in (cells, cells.mc.derived()):
        bias, cv = (x.isel(amplitude=0, fmax=0) for x in (part.mc.bias(), part.mc.cv()))
        for name in part["parameter"].values:
            truth, unit = (
                float(part["truth"].sel(parameter=name)),
                str(part["parameter_unit"].sel(parameter=name).item()),
            )
            b, c = bias.sel(parameter=name), cv.sel(parameter=name)
            held = "" if name not in coverage["parameter"] else _interval(coverage.sel(parameter=name))
            found.append([str(name), f"{truth:.4g} {unit}", _error(b, 100 / abs(truth)), _error(c, 100.0), held])
    return found


def _error(x: object, scale: float) -> str:
    value, error = (scale * float(x[k]) for k in ("value", "mcse"))  # type: ignore[index]
    return f"{value:.2g} ± {error:.1g}"


def _interval(x: object) -> str:
    value, low, high = (float(x[k]) for k in ("value", "lower", "upper"))  # type: ignore[index]
    scale = 100.0 if value <= 1 else 1.0
    return f"{scale * value:.0f} [{scale * low:.0f}, {scale * high:.0f}] %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("studies", nargs="+", metavar="STUDY", help="name of a study in pipelines")
    measured.add_option(parser)
    args = parser.parse_args()
    tables = {}
    for name in args.studies:
        tables[name] = (HEADER, rows(FOLDER / f"{name}.toml"))
        print(name, *("  ".join(row) for row in tables[name][1]), sep="\n  ", flush=True)
    measured.write(args.json, {}, tables)


if __name__ == "__main__":
    main()
