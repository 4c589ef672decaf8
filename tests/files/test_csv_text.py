"""CSV for spreadsheets: numbers stay numbers, texts stay texts."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from mcstudy.files.csv_text import csv_text


def cells(*row: object) -> list[str]:
    return list(csv.reader(csv_text(["a"] * len(row), [row]).splitlines()))[1]


@pytest.mark.parametrize("text", ["=1+1", "+K11", "-K11", "@SUM(A1)", "\t=1", " =1", "-1+1", "+1;2", "＝1", "=", "+"])
def test_a_text_that_a_spreadsheet_would_compute_gets_an_apostrophe(text: str) -> None:
    assert cells(text) == [f"'{text}"]


@pytest.mark.parametrize("text", ["-3.2", "+1", "-1e-300", "-", "K11", "a=b", "3 - 2", "", "−3"])
def test_numbers_and_other_texts_are_as_they_were(text: str) -> None:
    assert cells(text) == [text]


def test_numbers_are_written_in_full() -> None:
    assert cells(-0.1, np.float64(1 / 3), np.int64(-4), True, None, np.nan) == [
        "-0.1",
        "0.3333333333333333",
        "-4",
        "True",
        "",
        "",
    ]


def test_a_header_is_text_too() -> None:
    assert csv_text(["=a", "b"], []) == "'=a,b"
