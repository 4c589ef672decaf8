"""Is the paper's "about 20 starts" explained by its solver? Tables of the study `pipelines/paper_solver.toml`.

mcstudy run pipelines/paper_solver.toml -o results/paper_solver.zarr
python pipelines/validation/paper_solver.py results/paper_solver.zarr
"""

import argparse

import numpy as np
import xarray as xr

import mcstudy as mc

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
SUCCESS = 1e-4
"""A start succeeds whose cost is within this fraction of the lowest cost that lm found for the realization."""


def curves(results: xr.DataTree) -> list[str]:
    """Starts to the asymptote [95 % interval] at each of `TOLERANCES`, and success of a start, by group."""
    lines = [f"{'group':<22}{'N m':>5}{'success ± MCSE':>18}" + "".join(f"{t:>16g}" for t in TOLERANCES)]
    lowest = results["lm"]["cost"].min("start")
    for name, node in results.children.items():
        if name.startswith(("accuracy", "theory", "paper_theory")):
            continue
        cube = node.to_dataset()
        found = [cube.mc.asymptote(t) for t in TOLERANCES]
        for a in cube["amplitude"].values.tolist():
            success = ""
            if cube["fmax"].values.tolist() == [1.2] and name != "paper_no_noise":
                limit = lowest.sel(amplitude=a).isel(realization=slice(0, cube.sizes["realization"])) * (1 + SUCCESS)
                rate = 100 * (cube["cost"].sel(amplitude=a) <= limit).mean("start").values.ravel()
                success = f"{rate.mean():.0f} ± {rate.std(ddof=1) / np.sqrt(rate.size):.0f} %"
            cells = [f.sel(amplitude=a).isel(fmax=0) for f in found]
            starts = "".join(f"{f'{float(c.value):g} [{float(c.lower):.0f}, {float(c.upper):.0f}]':>16}" for c in cells)
            lines.append(f"{name:<22}{a:>5g}{success:>18}{starts}")
    return lines


def without_noise(results: xr.DataTree) -> list[str]:
    """Best of 50 starts without noise up to 8 Hz: cost, mean and largest error of the parameters, median [range]."""
    lines = [f"{'best of all starts, no noise, 8 Hz':<36}{'J':>28}{'mean error (%)':>30}{'largest error (%)':>30}"]
    for name, node in results.children.items():
        if "theory" in name:
            best = node.to_dataset().mc.best()
            error = 100 * np.abs(best["estimate"] / best["truth"] - 1)
            columns = (best["cost"].values, error.mean("parameter").values, error.max("parameter").values)
            cells = [f"{np.median(x):.2g} [{x.min():.2g}, {x.max():.2g}]" for x in columns]
            lines.append(f"{name:<36}{cells[0]:>28}{cells[1]:>30}{cells[2]:>30}")
    return lines


def accuracy(results: xr.DataTree) -> list[str]:
    """Mean absolute bias and mean CV of the 12 parameters by solver, and the paired difference, ± MCSE (jackknife)."""
    shares = []
    for name in ("accuracy_lm", "accuracy_paper"):
        best = results[name].to_dataset().mc.best()
        shares.append(
            (best["estimate"] / best["truth"]).isel(amplitude=0).transpose("fmax", "realization", "parameter")
        )
    lines = [f"{'Fmax (Hz)':<12}{'lm':>16}{'paper':>16}{'difference':>16}"]
    n = shares[0].sizes["realization"]
    for what in ("bias", "CV"):
        for f, fmax in enumerate(shares[0]["fmax"].values.tolist()):
            pair = [s.values[f] for s in shares]
            whole = _statistics(what, pair, np.ones(n, dtype=bool))
            parts = np.array([_statistics(what, pair, np.arange(n) != k) for k in range(n)])
            error = np.sqrt((n - 1) / n * ((parts - parts.mean(0)) ** 2).sum(0))
            cells = [f"{v:.1f} ± {e:.1f} %" for v, e in zip(whole, error, strict=True)]
            lines.append(f"{f'{what}, {fmax:g}':<12}" + "".join(f"{c:>16}" for c in cells))
    return lines


def _statistics(what: str, pair: list[np.ndarray], keep: np.ndarray) -> np.ndarray:
    """A statistic of both solvers and its difference, %; no CV (NaN) where every estimate of a parameter is zero."""
    both = []
    for x in (x[keep] for x in pair):
        mean, sd = x.mean(0), x.std(0, ddof=1)
        cv = np.divide(sd, mean, out=np.full_like(sd, np.nan), where=mean != 0)
        both.append(100 * np.mean(np.abs(mean - 1) if what == "bias" else cv))
    return np.array([*both, both[1] - both[0]])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cube", help="cube of pipelines/paper_solver.toml")
    tree = mc.open_results(parser.parse_args().cube)
    print("\n".join([*curves(tree), "", *without_noise(tree), "", *accuracy(tree)]))
