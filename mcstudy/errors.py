"""All exceptions that this package raises deliberately.

Errors caused by user input (``InputError`` and its subclasses) have a one-line message that names the file, the field
and the expected value; the command line prints that line and exits with code 2.
"""

from __future__ import annotations


class McstudyError(Exception):
    """Base of every deliberate error of this package."""


class InputError(McstudyError):
    """Invalid user input (a file, a field, an argument); the message is one line."""


class ModelError(InputError):
    """A declared model contradicts itself: an unknown name, a duplicate, an impossible bound."""


class DesignError(InputError):
    """A study file is not valid."""


class StoreError(InputError):
    """A results cube or another file cannot be opened, or does not fit the study."""


class StudyChangedError(StoreError):
    """The cube on disk was made with a different study file."""


class RecordingError(InputError):
    """A recording is not usable: gaps, wrong units, or a wrong period of the stimulus."""


class FallsError(InputError):
    """A simulated body is unstable or falls in the simulation; smaller effects or shorter delays may stabilize it."""


class Interrupted(McstudyError):
    """The run was stopped before it was complete; it can be resumed."""


class Stopped(Interrupted):
    """Work of which nothing is stored was stopped; it has to begin again."""
