"""Plain text as a page shows it: one minus sign, also in numbers that Python prints with a hyphen, and code as code."""

from __future__ import annotations

import re

_PLACES = re.compile(
    r"(?P<kept><(pre|code|script|style)\b.*?</\2>|<[^>]*>)"
    r"|`(?P<code>[^`<>\n]+)`"
    r"|(?<=[\s>;])(?P<none>-)(?=[<:&])"
    r"|(?<![\w.-])-(?=\.?\d)"
    r"|(?<=\de)-(?=\d)"
    r"|(?P<torque>\bN m\b)",
    re.DOTALL,
)


def typeset(page: str) -> str:
    """The same HTML with a true minus before numbers and in their exponents, a dash for a cell without a number, and
    words between backticks as code, and N·m for the N m of files.

    Commands, code, scripts and attributes stay as they are: they are copied or read by programs.
    """
    return _PLACES.sub(_shown, page)


def _shown(match: re.Match[str]) -> str:
    if match["code"]:
        return f"<code>{match['code']}</code>"
    if match["torque"]:
        return "N·m"
    return match["kept"] or ("–" if match["none"] else "−")
