"""Exit codes of the command, each said once: ``--help`` and the README's line are made of these."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """How a command ended; every verb returns one of these."""

    sentence: str

    def __new__(cls, value: int, sentence: str) -> Exit:
        """A code and what it says."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member

    DONE = 0, "done"
    BAD_INPUT = 2, "bad input (one line: file, field, what was expected)"
    INTERRUPTED = 3, "interrupted, the same command resumes"
    FITS_FAILED = 4, "some fits failed (listed)"
    MISSED = 5, "a target of the challenge is missed beyond doubt (gap challenge with --check)"
    DIFFERS = 6, "damage, or a difference from what is stored (verify, replay)"
    NOT_REACHED = 7, "the budget is spent before the target is reached (run --until-mcse)"
    STOPPED = 130, "stopped, with nothing to resume"


def exit_codes() -> str:
    """All of them in one sentence."""
    return "; ".join(f"{code.value} {code.sentence}" for code in Exit)
