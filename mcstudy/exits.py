"""Exit codes of the command, each defined once; ``--help`` and the README print these sentences."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """Exit codes; every verb returns one of these."""

    sentence: str

    def __new__(cls, value: int, sentence: str) -> Exit:
        """An exit code and its meaning."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member

    DONE = 0, "done"
    BAD_INPUT = 2, "bad input (one line names file, field and expected value)"
    INTERRUPTED = 3, "interrupted, the same command resumes"
    FITS_FAILED = 4, "some fits failed (listed)"
    MISSED = 5, "a target of the challenge is missed at the 99.9 % level (gap challenge with --check)"
    DIFFERS = 6, "stored results are damaged or not reproduced (verify, replay)"
    NOT_REACHED = 7, "the budget of fits ran out before the requested precision was reached (run, solve)"
    UNREACHABLE = 8, "no allowed design reaches the target (solve)"
    STOPPED = 130, "stopped, nothing to resume"


def exit_codes() -> str:
    """All of them in one sentence."""
    return "; ".join(f"{code.value} {code.sentence}" for code in Exit)
