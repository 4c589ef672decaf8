"""Every error this package raises on purpose, in one place.

Errors that a user caused (``InputError`` and its children) carry a one-line message that names the file, the
field and what was expected; the command line prints that line and exits with status 2.
"""

from __future__ import annotations


class McstudyError(Exception):
    """Base of every deliberate error of this package."""


class InputError(McstudyError):
    """Something the user gave (a file, a field, an argument) is not usable; the message is one line."""


class ModelError(InputError):
    """A declared model contradicts itself: an unknown name, a duplicate, an impossible bound."""


class DesignError(InputError):
    """A study file is not valid."""


class StoreError(InputError):
    """A results store cannot be opened, or is not what the study needs."""


class StudyChangedError(StoreError):
    """The store on disk belongs to a different study file."""


class RecordingError(InputError):
    """A recording is not usable: gaps, wrong units, a period the stimulus does not have."""


class FallsError(InputError):
    """A simulated body cannot stand, or falls in the simulation; smaller effects or shorter delays may hold it."""


class Interrupted(McstudyError):
    """The run was stopped before it was complete; what is stored can be resumed."""
