"""Build the documentation site: ``python -m pipelines.docs`` (needs the extra ``docs``).

Warnings and broken links are errors.

Nothing is fetched: the site has no external fonts or scripts, and links to other sites are listed in
``external_links.txt`` beside it, not followed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from pipelines.docs.links import broken, external, pages

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "docs"


def main(arguments: list[str] | None = None) -> int:
    """Build from scratch and check the links; returns 0 when nothing is wrong."""
    parser = argparse.ArgumentParser(prog="python -m pipelines.docs", description="Build the documentation site.")
    parser.add_argument("-o", "--out", type=Path, default=BUILD, help="folder to write; default build/docs")
    out = parser.parse_args(arguments).out.resolve()
    try:
        from sphinx.cmd.build import build_main
    except ModuleNotFoundError:
        print("docs: Sphinx is not installed; pip install -c .ci/constraints.txt -e '.[docs]'", file=sys.stderr)
        return 2
    site = out / "site"
    shutil.rmtree(site, ignore_errors=True)
    quiet = ["-q", "-W", "--keep-going", "-E", "-c", str(Path(__file__).parent), "-d", str(out / "doctrees")]
    if status := build_main([*quiet, str(ROOT), str(site)]):
        return status
    found = pages(site)
    faults = broken(found)
    (out / "external_links.txt").write_text("\n".join([*external(found), ""]), encoding="utf-8")
    print("\n".join([*faults, f"{site / 'index.html'}: {len(found)} pages"]))
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
