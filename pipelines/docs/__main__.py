"""Build the documentation site: ``python -m pipelines.docs`` (needs the extra ``docs``).

Warnings, broken links and numbers that no command has measured (`pipelines.measured`) are errors;
``--numbers`` writes the measured numbers into the pages, ``--pictures`` the pictures of the README; both build nothing.

Nothing is fetched: the site has no external fonts or scripts, and links to other sites are listed in
``external_links.txt`` beside it, not followed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from pipelines import measured
from pipelines.docs.links import broken, external, pages

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "docs"


def main(arguments: list[str] | None = None) -> int:
    """Build from scratch and check the links; returns 0 when nothing is wrong."""
    parser = argparse.ArgumentParser(prog="python -m pipelines.docs", description="Build the documentation site.")
    parser.add_argument("-o", "--out", type=Path, default=BUILD, help="folder to write; default build/docs")
    parser.add_argument("--numbers", action="store_true", help="write the measured numbers into the pages, and end")
    parser.add_argument("--pictures", action="store_true", help="write the pictures of the README, and end")
    args = parser.parse_args(arguments)
    out = args.out.resolve()
    if args.numbers:
        return _write_numbers()
    if args.pictures:
        from pipelines.docs.pictures import write_pictures

        write_pictures()
        return 0
    if faults := [fault for page in measured.pages() for fault in measured.stale(page)]:
        print("\n".join(faults), file=sys.stderr)
        return 1
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


def _write_numbers() -> int:
    """Write the measured numbers into the pages; returns 0 when every number that a page names is there."""
    for page in measured.pages():
        text = page.read_text(encoding="utf-8")
        try:
            right = measured.shown(text)
        except measured.UnknownNumberError as error:
            print(f"{page.relative_to(ROOT)}: {error}", file=sys.stderr)
            return 1
        if right != text:
            page.write_text(right, encoding="utf-8")
            print(f"{page.relative_to(ROOT)}: written")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
