"""What ``show`` prints of a sweep: one line for each of its cells, in place of all tables of every cell."""

from __future__ import annotations

from typing import Any

from mcstudy.analysis.show import FIRST
from mcstudy.analysis.statistics import CELL_STATISTICS
from mcstudy.text_tables import Table, counted, fill, number, starts_in_words, table

SHOWN = ("mean_absolute_bias_percent", "mean_spread_percent", "unstable", "inside_bounds")
"""Statistics of a cell in its line."""


def sweeps_of(groups: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """The groups of each sweep by its name."""
    out: dict[str, list[dict[str, Any]]] = {}
    for group in groups.values():
        if "cell" in group:
            out.setdefault(group["cell"]["sweep"], []).append(group)
    return out


def sweep_text(name: str, cells: list[dict[str, Any]]) -> str:
    """The tables of a sweep: every cell at its highest Fmax and largest amplitude."""
    d, at = cells[0]["design"], cells[0]["cell"]["at"]
    axes = " x ".join(f"{axis} ({len({str(c['cell']['at'][axis]) for c in cells})})" for axis in at)
    starts = starts_in_words(d["starts"], d.get("until_certain", False))
    paired = "; all share the noise of a realization, so differences along an axis are paired" * d["noise"]
    where = f"{d['fmax'][-1]:g} Hz and {d['amplitude'][-1]:g} {d['amplitude_unit']}"
    head = [
        f"Sweep {name}: {counted(len(cells), 'cell')}, {axes}; {counted(d['realizations'], 'realization')} of {starts}"
        f" in each{paired}.",
        f"At {where} (other Fmax and amplitudes: --csv FILE, or .mc in Python). bias: mean estimate minus truth, % of "
        "the truth.",
    ]
    notes = dict.fromkeys(note for c in cells for note in c["notes"] if note.startswith(FIRST[0]))
    tables = [table(t.header, t.rows) for t in sweep_tables(cells)]
    largest = max((_error(p) for c in cells for p in c["cells"][-1]["parameters"]), default=0.0)
    foot = f"Bias, % of the truth; largest Monte Carlo error {number(largest, 2)} %."
    return "\n\n".join(["\n".join(map(fill, [*head, *notes])), *tables]) + "\n" + fill(foot)


def sweep_tables(cells: list[dict[str, Any]]) -> list[Table]:
    """A row for each cell at its highest Fmax and largest amplitude: its statistics, and the bias of its parameters."""
    shown = [s for s in CELL_STATISTICS if s.key in SHOWN]
    rows = [[_label(c), *(_number(c["cells"][-1][s.key], s.factor) for s in shown)] for c in cells]
    parameters = list(dict.fromkeys(p["name"] for c in cells for p in c["cells"][-1]["parameters"]))
    biases = [[_label(c), *_biases(c, parameters)] for c in cells]
    first = " ".join(cells[0]["cell"]["at"])
    return [
        Table("Best fits", [first, *(s.head for s in shown)], rows),
        Table("Bias, % of the truth", [first, *parameters], biases),
    ]


def _label(cell: dict[str, Any]) -> str:
    return " ".join(map(str, cell["cell"]["at"].values()))


def _number(entry: dict[str, Any], factor: float) -> str:
    return number(None if entry["value"] is None else factor * entry["value"])


def _biases(cell: dict[str, Any], parameters: list[str]) -> list[str]:
    held = {p["name"]: p for p in cell["cells"][-1]["parameters"]}
    return [number(_percent(held[n], "value"), 2) if n in held else "-" for n in parameters]


def _percent(p: dict[str, Any], key: str) -> float | None:
    value = p["bias"][key]
    return None if value is None or not p["truth"] else 100 * value / abs(p["truth"])


def _error(p: dict[str, Any]) -> float:
    return _percent(p, "mcse") or 0.0


COLUMNS = (
    *("amplitude", "fmax_hz", "parameter", "unit", "realizations"),
    *("population", "average", "sd", "se_average", "mse", "cover_95", "bias", "bias_mcse"),
)


def csv_rows(data: dict[str, Any]) -> tuple[list[str], list[list[Any]]]:
    """Every parameter of every cell as a row under a header, with the columns that statisticians know from Mplus.

    population: true value. average, sd: of the estimates. se_average: root mean square of the standard errors.
    mse: mean squared error. cover_95: share of the 95 % intervals that hold the truth. Empty where there is none.
    """
    axes = list(dict.fromkeys(a for g in data["groups"].values() if "cell" in g for a in g["cell"]["at"]))
    rows: list[list[Any]] = []
    for name, group in data["groups"].items():
        cell = group.get("cell", {"sweep": name, "at": {}})
        labels = [cell["at"].get(axis, "") for axis in axes]
        for at in group["cells"]:
            where = [at["amplitude"], at["fmax"]]
            rows += [[cell["sweep"], *labels, *where, *_row(p, at)] for p in at["parameters"]]
    return ["group", *axes, *COLUMNS], rows


def _row(p: dict[str, Any], cell: dict[str, Any]) -> list[Any]:
    """The columns of one parameter."""
    bias, rmse = p["bias"]["value"], p["rmse"]["value"]
    average = None if bias is None or p["truth"] is None else p["truth"] + bias
    mse = None if rmse is None else rmse**2
    errors, cover = (p.get(key, {}).get("value") for key in ("model_se", "coverage"))
    row = [p["name"], p["unit"], cell["realizations"]["used"], p["truth"], average, p["sd"]["value"], errors, mse]
    return [*row, cover, bias, p["bias"]["mcse"]]
