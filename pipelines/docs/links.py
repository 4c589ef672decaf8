"""Links of the built site: those within it are followed, page and anchor; those to other sites are listed."""

from __future__ import annotations

from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


@dataclass
class Page(HTMLParser):
    """One page: the ids it defines, where it links to, and the files it loads (scripts, styles, images)."""

    path: Path
    ids: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loads: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect the ids and addresses of one element."""
        given = {name: value for name, value in attrs if value}
        if "id" in given:
            self.ids.add(given["id"])
        address = given.get("href") or given.get("src")
        if address:
            (self.links if tag == "a" else self.loads).append(address)


def pages(site: Path) -> dict[Path, Page]:
    """All pages of a site by path."""
    return {path: Page(path) for path in sorted(site.rglob("*.html"))}


def elsewhere(address: str) -> bool:
    """Whether an address is on another site."""
    parts = urlsplit(address)
    return bool(parts.scheme or parts.netloc) and parts.scheme not in ("data", "mailto")


def broken(found: dict[Path, Page]) -> list[str]:
    """Links within the site to a file or an anchor that does not exist, and files loaded from elsewhere."""
    out = []
    for path, page in found.items():
        out += [f"{path}: loads {a}, which is on another site" for a in page.loads if elsewhere(a)]
        for address in [*page.links, *page.loads]:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = found.get(target)
            if not target.is_file() or (known and parts.fragment and unquote(parts.fragment) not in known.ids):
                out.append(f"{path}: links to {address}, which does not exist")
    return out


def external(found: dict[Path, Page]) -> list[str]:
    """Addresses on other sites that pages link to."""
    return sorted({a for page in found.values() for a in page.links if elsewhere(a)})
