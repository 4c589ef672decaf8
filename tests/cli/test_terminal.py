"""Output that the terminal cannot show, that nobody reads, or that has no room."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mcstudy.cli.verbs import verbs
from mcstudy.exits import Exit

FULL = Path("/dev/full")


def command(*words: str, **how: object) -> subprocess.CompletedProcess[bytes]:
    code = "import sys; from mcstudy.cli import main; sys.exit(main())"
    return subprocess.run([sys.executable, "-c", code, *words], check=False, timeout=120, **how)  # type: ignore[call-overload,no-any-return]


@pytest.mark.parametrize(
    ("words", "encoding"),
    [
        (("studies",), "latin-1"),
        (("help", "recordings"), "ascii"),
        (("gap", "effects"), "cp1252"),
        (("show", "CUBE"), "ascii"),
        (("show", "CUBE"), "utf-16"),
        (("fit", "nö±→.nc"), "ascii"),
        (("fit", "nö±→.nc"), "cp1252"),
    ],
)
def test_characters_that_cannot_be_shown_are_replaced(words: tuple[str, ...], encoding: str, two_chunks: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    ran = command(*(str(two_chunks) if w == "CUBE" else w for w in words), capture_output=True, env=environment)
    assert ran.returncode == (Exit.BAD_INPUT if words[0] == "fit" else Exit.DONE)
    assert b"Traceback" not in ran.stderr
    assert (ran.stdout or ran.stderr).decode(encoding)


def test_every_help_is_shown_where_only_ascii_is() -> None:
    code = "import contextlib, sys; from mcstudy.cli import main\nfor sys.argv[1:] in map(str.split, sys.argv[1:]):\n"
    code += "    with contextlib.suppress(SystemExit): main()"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    words = [sys.executable, "-c", code, *(f"{verb} --help" for verb in verbs())]
    ran = subprocess.run(words, check=False, timeout=120, capture_output=True, env=environment)
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert ran.stdout.count(b"usage: mcstudy ") == len(verbs())


def test_json_loses_nothing_in_any_encoding(two_chunks: Path) -> None:
    found = [
        command(
            "show", str(two_chunks), "--json", capture_output=True, env={**os.environ, "PYTHONIOENCODING": e}
        ).stdout
        for e in ("ascii", "utf-8")
    ]
    assert found[0].isascii()
    assert not found[1].isascii()
    assert json.loads(found[0]) == json.loads(found[1])


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")
@pytest.mark.parametrize("words", [("studies",), ("show", "CUBE"), ("show", "CUBE", "--json"), ("--version",)])
def test_output_without_room_is_one_line(words: tuple[str, ...], two_chunks: Path) -> None:
    with FULL.open("wb") as full:
        ran = command(*(str(two_chunks) if w == "CUBE" else w for w in words), stdout=full, stderr=subprocess.PIPE)
    assert ran.returncode == Exit.BAD_INPUT
    assert ran.stderr == b"mcstudy: output: cannot be written: No space left on device\n"


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")
def test_messages_without_room_leave_the_exit_code() -> None:
    with FULL.open("wb") as full:
        assert command("fit", "nothing.nc", stderr=full).returncode == Exit.BAD_INPUT


def test_an_output_that_nobody_reads_is_no_error() -> None:
    read, written = os.pipe()
    os.close(read)
    with os.fdopen(written, "wb") as pipe:
        ran = command("studies", stdout=pipe, stderr=subprocess.PIPE)
    assert (ran.returncode, ran.stderr) == (Exit.DONE, b"")


def test_a_message_carries_no_command_for_the_terminal() -> None:
    ran = command("fit", "no\x1b[2Jthing\a.nc", capture_output=True)
    assert ran.returncode == Exit.BAD_INPUT
    assert b"\x1b" not in ran.stderr
    assert b"no\\x1b[2Jthing\\x07.nc" in ran.stderr
