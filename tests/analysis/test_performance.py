"""Measures of estimates and standard errors: equal to rsimsum's, and to the paper's formulas."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import mcstudy as mc
from mcstudy.analysis.performance import intervals, performance, relative_precision
from mcstudy.cli import main
from mcstudy.errors import InputError
from mcstudy.exits import Exit

Cube = Callable[..., xr.Dataset]
HEADER = b"parameter,realization,estimate,truth\n"
GOLDEN = Path(__file__).parent / "golden"
NAMES = {
    "bias": "bias",
    "empse": "empirical_se",
    "mse": "mse",
    "modelse": "model_se",
    "relerror": "relative_error",
    "cover": "coverage",
    "becover": "bias_eliminated_coverage",
    "relprec": "relative_precision",
}


def estimates() -> pd.DataFrame:
    return pd.read_csv(GOLDEN / "estimates.csv")


def test_all_measures_and_their_errors_are_rsimsums() -> None:
    ours = mc.performance(estimates())
    compared = 0
    for row in pd.read_csv(GOLDEN / "rsimsum.csv").itertuples():
        if row.stat in NAMES and not (row.stat == "relprec" and row.method == "paper"):
            found = ours.sel({"measure": NAMES[row.stat], "estimator": row.method, "parameter": row.parameter})
            np.testing.assert_allclose([found["value"], found["mcse"]], [row.est, row.mcse], rtol=1e-10)
            compared += 1
        if row.stat == "nsim":
            assert (ours["n"].sel({"estimator": row.method, "parameter": row.parameter}) == row.est).all()
    assert compared == 2 * (7 + 8)
    assert (ours["n"] + ours["left_out"] == 40).all()


def test_the_measures_of_standard_errors_are_over_the_realizations_that_have_one() -> None:
    rng = np.random.default_rng(0)
    x, se = 3 + rng.standard_normal(30), 1 + 0.1 * rng.standard_normal(30)
    se[:10] = np.nan
    found = performance(
        *(xr.DataArray(v, dims="realization") for v in (x,)), xr.DataArray(2.5), xr.DataArray(se, dims="realization")
    )
    kept = slice(10, None)
    half = 1.959963984540054 * se[kept]
    expected = {
        "bias": x.mean() - 2.5,
        "model_se": np.sqrt((se[kept] ** 2).mean()),
        "relative_error": 100 * (np.sqrt((se[kept] ** 2).mean()) / x[kept].std(ddof=1) - 1),
        "coverage": (abs(x[kept] - 2.5) <= half).mean(),
        "bias_eliminated_coverage": (abs(x[kept] - x[kept].mean()) <= half).mean(),
    }
    for measure, value in expected.items():
        assert float(found["value"].sel(measure=measure)) == pytest.approx(value, rel=1e-12), measure
    assert found["n"].sel(measure=["bias", "coverage"]).values.tolist() == [30, 20]
    assert found["left_out"].sel(measure=["bias", "coverage"]).values.tolist() == [0, 10]


def test_errors_are_the_scatter_of_repeated_studies_and_normal_intervals_hold_the_truth() -> None:
    rng, n = np.random.default_rng(1), 100
    z, other = rng.standard_normal((2, 2000, n))
    dims = ("study", "realization")
    se = np.sqrt(rng.chisquare(20, (2000, n)) / 20)
    x, y = xr.DataArray(z, dims=dims), xr.DataArray(0.6 * z + 0.8 * other, dims=dims)
    found = performance(x, xr.DataArray(0.0), xr.DataArray(se, dims=dims))
    scatter = found["value"].std("study")
    np.testing.assert_allclose(np.sqrt((found["mcse"] ** 2).mean("study")), scatter, rtol=0.08)
    assert float(found["value"].sel(measure="coverage").mean()) == pytest.approx(0.939, abs=0.004)
    gain = relative_precision(x, y)
    assert float(np.sqrt((gain["mcse"] ** 2).mean())) == pytest.approx(float(gain["value"].std()), rel=0.08)


def test_intervals_of_coverages_stay_between_zero_and_one() -> None:
    x = xr.DataArray(np.zeros(5), dims="realization")
    found = performance(x, xr.DataArray(0.0), x + 1).sel(measure="coverage")
    assert float(found["value"]) == float(found["upper"]) == 1
    assert 0 < float(found["lower"]) < 1


def test_a_zipper_ranks_the_intervals_by_their_distance_from_the_truth() -> None:
    x = xr.DataArray([0.0, 3.0, -1.0, np.nan], dims="realization")
    found = intervals(x, xr.DataArray(0.0), xr.ones_like(x))
    np.testing.assert_allclose(found["centile"], [1 / 3, 1, 2 / 3, np.nan])
    assert found["holds"].values.tolist() == [True, False, True, False]


def test_the_order_of_rows_is_nothing_and_that_of_methods_is_the_tables() -> None:
    table = estimates()
    first = mc.performance(table)
    again = mc.performance(table.sample(frac=1, random_state=1), reference="paper")
    assert first["estimator"].values.tolist() == ["paper", "ml"]
    for name in ("value", "mcse", "n"):
        np.testing.assert_allclose(
            again[name].sel(first["estimator"].coords).reindex_like(first[name]), first[name], rtol=1e-12
        )
    assert np.isfinite(
        mc.performance(table, reference="ml")["value"].sel({"measure": "relative_precision", "estimator": "paper"})
    ).all()


def test_a_dataset_and_a_table_without_methods_are_accepted() -> None:
    table = estimates().query("method == 'ml'").drop(columns="method")
    found = mc.performance(table)
    assert found["value"].dims == ("measure", "parameter")
    data = xr.Dataset.from_dataframe(table.set_index(["realization", "parameter"]))
    data["truth"] = data["truth"].max("realization")
    xr.testing.assert_allclose(mc.performance(data)["value"], found["value"].sel(parameter=data["parameter"]))
    alone = mc.performance(table.drop(columns="standard_error"))
    assert alone["measure"].values.tolist() == ["bias", "empirical_se", "mse"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop(columns="truth"), "truth: expected a column of this name, got parameter"),
        (lambda t: pd.concat([t, t[:1]]), "got two for method paper, realization 0, parameter K11"),
        (lambda t: t.assign(truth=t["estimate"]), "truth: expected the same number in all rows of parameter K11"),
        (lambda t: t.assign(standard_error=-1.0), "standard_error: expected no negative value, got -1"),
        (lambda t: t.assign(estimate="high"), "estimate: expected numbers"),
        (lambda t: t.assign(estimate=np.inf), "estimate: expected finite numbers or NaN"),
        (lambda _: {"parameter": ["a"], "estimate": [1, 2]}, "data: expected a table"),
    ],
)
def test_a_mistake_in_a_table_is_named_in_one_line(change: Callable[[pd.DataFrame], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        mc.performance(change(estimates()))  # type: ignore[arg-type]
    assert "\n" not in str(error.value)


def test_a_method_or_level_that_does_not_exist_is_refused() -> None:
    with pytest.raises(InputError, match="reference: expected one of paper, ml, got 'other'"):
        mc.performance(estimates(), reference="other")
    with pytest.raises(InputError, match="level: expected a number between 0 and 1, got 95"):
        mc.performance(estimates(), level=95)


def test_a_file_gives_the_same_numbers_in_python_and_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    expected = mc.performance(estimates(), reference="ml")
    xr.testing.assert_identical(mc.performance(GOLDEN / "estimates.csv", reference="ml"), expected)
    other = tmp_path / "other.csv"
    estimates().to_csv(other, sep=";", index=False, encoding="utf-8-sig")
    xr.testing.assert_identical(mc.performance(str(other), reference="ml"), expected)
    assert main(["performance", str(other), "--reference", "ml", "-o", str(tmp_path / "out.csv")]) == Exit.DONE
    (header, _, *rows), told = capsys.readouterr().out.split("\n\n")[0].splitlines(), expected["measure"].values
    assert header.split() == ["method", "parameter", "n", *told]
    assert [row.split()[:2] for row in rows] == [
        [m, p] for m in expected["estimator"].values for p in expected["parameter"].values
    ]
    written = pd.read_csv(tmp_path / "out.csv").set_index(["measure", "estimator", "parameter"])["value"].to_xarray()
    dims = expected["value"].dims
    np.testing.assert_allclose(written.sel({d: expected[d] for d in dims}).transpose(*dims), expected["value"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read: No such file or directory"),
        (b"", "expected one column 'realization' in the first line, found nothing"),
        (b"\x89PNG", "expected one column 'realization' in the first line, found"),
        (b"a,b\n1,2\n", "expected one column 'realization' in the first line, found a, b\n"),
        (b"parameter,realization,estimate,truth\nK,0,one,1\n", "line 2: estimate: expected a number, got 'one'"),
        (b"parameter,realization,estimate,truth\nK,0,2,1\nK,0,3,1\n", "data: expected one row per realization"),
        (HEADER + b"K,0,2,1\nK,1,2,1,1\n", "line 3: expected 4 columns, got 5; row names need a column name too"),
        (HEADER + b"a,K,0,2,1\nb,K,1,2,1\n", "line 2: expected 4 columns, got 5; row names need a column name too"),
        (HEADER + b"K,0,2,1\n\nK,1,2\n", "line 4: expected 4 columns, got 3"),
        (HEADER + b"K,0,2,5,1,0\n", "line 2: expected 4 columns, got 6; where numbers have decimal commas"),
        (
            HEADER + b'K,0,"2,5",1\nK,1,2.5,1\n',
            "line 2: estimate: expected a number, got '2,5'; write all numbers with",
        ),
        (HEADER + b'K,0,"2,500",1\n', "is the comma of '2,500' a decimal sign or between thousands?"),
        (HEADER + b'"K,0,2,1\nK,1,2,1\n', "line 2: expected cells of text or numbers, with quotes in pairs"),
        (HEADER + b"K,0,2,1\nTotal\n", "line 3: expected 4 columns, got 1; remove lines that are no rows"),
        (HEADER + b"K,0,0x10,1\n", "line 2: estimate: expected a number, got '0x10'"),
        (HEADER + b"K,0,1_0,1\n", "line 2: estimate: expected a number, got '1_0'"),
        (HEADER + b"K,0,1e999,1\n", "estimate: expected finite numbers or NaN, got infinity"),
        (HEADER + b"K,0,-1e200,1\n", "estimate: expected numbers up to 1e+100, whose squares are numbers, got 1e+200"),
        (
            HEADER.replace(b",", b";") + b"K;0;2,5;1\nK;1;2.5;1\n",
            "line 2: estimate: expected a number, got '2,5'; write all numbers with decimal points",
        ),
        (
            b"estimate," + HEADER + b"1,K,0,2,1\n",
            "expected one column 'estimate' in the first line, found estimate, ",
        ),
        (b"method," + HEADER + b",K,0,2,1\n", "line 2: method: expected a name, got an empty cell"),
        (HEADER + b",0,2,1\n", "line 2: parameter: expected a name, got an empty cell"),
        (HEADER + b"K,,2,1\n", "line 2: realization: expected a name, got an empty cell"),
        (HEADER, "data: expected at least one row"),
        (
            b"Parameter,realization,estimate,truth\nK,0,2,1\n",
            "expected one column 'parameter' in the first line, found Para",
        ),
        (HEADER + b"K,0,2,1\nK,1,\x1b[2J,1\n", "line 3: estimate: expected a number, got '\\x1b[2J'"),
    ],
)
def test_a_file_that_is_no_table_is_one_line_that_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes | None, message: str
) -> None:
    file = tmp_path / "table.csv"
    if content is not None:
        file.write_bytes(content)
    assert main(["performance", str(file)]) == Exit.BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith(f"mcstudy: {file}: {message}")
    assert error.count("\n") == 1


@pytest.mark.parametrize("names", [("1", "2"), ("TRUE", "FALSE"), ("NA", "NaN"), ("01", "1"), ("=a", "-b")])
def test_parameters_and_methods_are_called_whatever_they_are_called(
    names: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = estimates().replace({"parameter": dict(zip(("K11", "B11"), names, strict=True))})
    table = table.replace({"method": dict(zip(("paper", "ml"), names, strict=True))})
    table.to_csv(tmp_path / "names.csv", index=False)
    expected = mc.performance(estimates(), reference="ml")
    found = mc.performance(tmp_path / "names.csv", reference=names[1])
    assert found["parameter"].values.tolist() == list(names)
    chosen = found["value"].sel(estimator=names[0], parameter=names[1])
    np.testing.assert_array_equal(chosen, expected["value"].sel(estimator="paper", parameter="B11"))
    xr.testing.assert_identical(mc.performance(table, reference=names[1]), found)
    assert main(["performance", str(tmp_path / "names.csv")]) == Exit.DONE
    rows = capsys.readouterr().out.split("\n\n")[0].splitlines()[2:]
    assert [row.split()[:2] for row in rows] == [[m, p] for m in names for p in names]


def test_numbers_as_names_in_a_table_in_memory_become_text() -> None:
    found = mc.performance(estimates().replace({"method": {"paper": 1, "ml": 2}}), reference="2")
    assert found["estimator"].values.tolist() == ["1", "2"]


def test_a_semicolon_separates_numbers_with_decimal_commas(tmp_path: Path) -> None:
    expected = mc.performance(estimates())
    for separator in (";", "\t"):
        for first in ("", f"sep={separator}\n"):
            file = tmp_path / "comma.csv"
            file.write_text(first + estimates().to_csv(sep=separator, decimal=",", index=False), encoding="utf-8")
            xr.testing.assert_identical(mc.performance(file), expected)


def test_estimates_that_are_all_equal_have_no_scatter_and_no_relative_error() -> None:
    x = xr.DataArray(np.full((2, 200), 1.2), dims=("case", "realization"))
    x[1, ::2] = np.nextafter(1.2, 2)  # a bound that is reached to the last digit
    se = xr.full_like(x, 0.3) + 0.01 * xr.DataArray(np.random.default_rng(0).random(200), dims="realization")
    found = performance(x, xr.DataArray(1.0), se)
    assert found["value"].sel(measure="empirical_se").values.tolist() == [0.0, 0.0]
    assert found[["value", "mcse"]].sel(measure="relative_error").to_array().isnull().all()
    assert np.isnan(relative_precision(x, x + 1)["value"]).all()
    tiny = xr.DataArray(1 + 1e-12 * np.arange(5), dims="realization")
    assert float(performance(tiny, xr.DataArray(1.0))["value"].sel(measure="empirical_se")) > 1e-12


def test_the_number_of_standard_errors_is_told_where_some_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = estimates()
    table.loc[table["realization"] < 4, "standard_error"] = np.nan
    table.to_csv(tmp_path / "few.csv", index=False, na_rep="NA")
    assert main(["performance", str(tmp_path / "few.csv")]) == Exit.DONE
    out = capsys.readouterr().out
    assert all(row.split()[2:4] == ["38", "34"] for row in out.splitlines()[2:6])
    assert "n of SE: estimates with a standard error" in " ".join(out.split())


def test_names_are_no_commands_for_the_terminal_and_no_formulas_for_a_spreadsheet(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = estimates().replace({"parameter": {"K11": "\x1b[2J=x", "B11": '=HYPERLINK("http://a","b")'}})
    table.to_csv(tmp_path / "esc.csv", index=False)
    assert main(["performance", str(tmp_path / "esc.csv"), "-o", str(tmp_path / "out.csv")]) == Exit.DONE
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert "\\x1b[2J=x" in out
    written = pd.read_csv(tmp_path / "out.csv")
    assert set(written["parameter"]) == {"\x1b[2J=x", '\'=HYPERLINK("http://a","b")'}
    assert written["value"].min() < 0
    np.testing.assert_array_equal(
        written["value"].dropna(), mc.performance(table).to_dataframe()["value"].dropna().to_numpy()
    )


def test_a_dataset_may_call_its_methods_either_way() -> None:
    data = xr.Dataset.from_dataframe(estimates().set_index(["method", "realization", "parameter"]))
    data["truth"] = data["truth"].max(["realization", "method"])
    expected = mc.performance(estimates(), reference="ml")["value"]
    for given in (data, data.rename(method="estimator")):
        found = mc.performance(given, reference="ml")["value"]
        np.testing.assert_allclose(found.reindex_like(expected).transpose(*expected.dims), expected)


def test_a_table_is_read_as_every_delimited_text_is(tmp_path: Path) -> None:
    expected = mc.performance(estimates())
    text = estimates().to_csv(index=False)
    quoted = estimates().to_csv(index=False, quoting=csv.QUOTE_ALL)
    named = estimates().assign(**{"a, note": "1,5"}).to_csv(sep=";", decimal=",", index=False)
    for content in (
        *(text.encode(encoding) for encoding in ("utf-8-sig", "utf-16", "utf-16-le")),
        quoted.encode(),
        text.replace("\n", ",,\n").encode(),
        text.replace("\n", "\r").encode(),
        estimates().to_csv().encode(),
        named.encode(),
    ):
        (tmp_path / "table.csv").write_bytes(content)
        xr.testing.assert_identical(mc.performance(tmp_path / "table.csv"), expected)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.full((3, 1), np.inf), "estimate: expected finite numbers or NaN, got infinity"),
        (np.full((3, 1), -1e200), "estimate: expected numbers up to 1e\\+100"),
        (np.full((3, 1), "x"), "estimate: expected numbers, got values of type <U1"),
        (np.full((3, 1), 1j), "estimate: expected numbers, got values of type complex128"),
        (np.empty((0, 1)), "estimate: expected at least one value, got none"),
    ],
)
def test_a_dataset_is_checked_as_a_table_is(values: np.ndarray, message: str) -> None:
    data = xr.Dataset({"estimate": (("realization", "parameter"), values), "truth": ("parameter", [1.0])})
    with pytest.raises(InputError, match=message):
        mc.performance(data)
