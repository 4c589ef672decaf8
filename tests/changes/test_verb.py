"""A new verb is a module and a line in the table of verbs."""

from __future__ import annotations

from pathlib import Path

from changes import Copy

VERB = '''"""``mcstudy count``: how many fits a cube has."""

from __future__ import annotations

import argparse
from pathlib import Path

from mcstudy.exits import Exit

TOPIC = "cube"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("out", type=Path, help="results cube")


def main(args: argparse.Namespace) -> Exit:
    """Print the number; returns the exit code."""
    import mcstudy as mc

    print(sum(sum(counts.values()) for counts in mc.status(args.out).groups.values()))
    return Exit.DONE
'''

USE = """
from mcstudy.cli import main

assert main(["count", {cube!r}]) == 0
main(["help", "count"])
main([])
assert main(["count", "nowhere.zarr"]) == 2
"""


def test_a_new_verb_is_a_module_and_a_line_in_the_table_of_verbs(tmp_path: Path, tiny_cube: Path) -> None:
    copy = Copy(tmp_path)
    copy.add("mcstudy/cli/verbs/count.py", VERB)
    last = '    "completion": "print a script'
    copy.edit("mcstudy/cli/verbs/__init__.py", last, f'    "count": "print how many fits a cube has",\n{last}')
    printed = copy.run(USE.format(cube=str(tiny_cube)))
    assert printed.startswith("128\n")
    assert "usage: mcstudy count" in printed
    assert "results_schema/README.md" in printed, "the page of its topic follows its options"
    assert "print how many fits a cube has" in printed
    assert len(copy.touched) <= 3
