"""One minus sign on a page, and no change of what programs read."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest

from mcstudy.report.typeset import typeset


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("<td>-0.861 ± 0.032</td>", "<td>−0.861 ± 0.032</td>"),
        ("<td>4.5e-12 %</td>", "<td>4.5e−12 %</td>"),
        ("<p>[-5, -.3] of (-2)</p>", "<p>[−5, −.3] of (−2)</p>"),
        ("<td>-</td>", "<td>–</td>"),
        ("<p>&#x27;-&#x27;: nothing. -: none</p>", "<p>&#x27;–&#x27;: nothing. –: none</p>"),
        ("<p>J Neurosci Methods 296:44-56, 2018-01-15, p-value</p>", None),
        ("<p><code>--seed -1</code></p>", None),
        ("<p>see `gap next --trials -1`</p>", "<p>see <code>gap next --trials -1</code></p>"),
        (
            "<p>`one` and `two` at -1, one ` alone</p>",
            "<p><code>one</code> and <code>two</code> at −1, one ` alone</p>",
        ),
        ('<p title="`a`"><code>`b`</code></p>', None),
        ('<path d="M3-4h-2" aria-label="-3 to -1"/>', None),
        ("<script>x = -1;</script><pre>y = 1e-3</pre>", None),
    ],
)
def test_numbers_carry_a_true_minus_and_code_stays(written: str, shown: str | None) -> None:
    assert typeset(written) == (shown or written)


@pytest.mark.parametrize("page", ["paper_page", "gap_page", "fit_page"])
def test_a_page_has_one_minus_sign(page: str, request: pytest.FixtureRequest) -> None:
    file: Path = request.getfixturevalue(page)
    text = re.sub(r"<(pre|code|script|style)\b.*?</\1>", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
    words = html.unescape(re.sub(r"<[^>]*>", "|", text))
    assert "−" in words
    assert "`" not in words
    assert re.findall(r".{0,20}(?<![\w.-])-\.?\d.{0,10}|\de-\d", words) == []
