"""A picture of its own as an SVG document, drawn without matplotlib."""

from __future__ import annotations

import html
from collections.abc import Sequence


def svg_document(title: str, caption: str, size: tuple[float, float], left: float, body: Sequence[str]) -> str:
    """The elements ``body`` on a light ground of ``size`` (width, height), below a caption that begins at ``left``."""
    width, height = size
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" '
            'font-size="10" role="img">',
            f"<title>{html.escape(title)}</title>",
            f'<rect width="{width:g}" height="{height:g}" fill="#fefefe"/>',
            f'<text x="{left:g}" y="18" font-size="12">{html.escape(caption)}</text>',
            *body,
            "</svg>",
        ]
    )
