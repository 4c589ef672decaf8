"""One minus sign on a page: numbers that Python prints with a hyphen beside those of figures and equations."""

from __future__ import annotations

import re

_PLACES = re.compile(
    r"(?P<kept><(pre|code|script|style)\b.*?</\2>|<[^>]*>)"
    r"|(?<=[\s>;])(?P<none>-)(?=[<:&])"
    r"|(?<![\w.-])-(?=\.?\d)"
    r"|(?<=\de)-(?=\d)",
    re.DOTALL,
)


def true_minus(page: str) -> str:
    """The same HTML with a true minus before numbers and in their exponents, and a dash for a cell without a number.

    Commands, code, scripts and attributes stay as they are: they are copied or read by programs.
    """
    return _PLACES.sub(lambda m: m["kept"] or ("–" if m["none"] else "−"), page)
