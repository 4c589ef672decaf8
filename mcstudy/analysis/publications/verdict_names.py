"""Names of the verdicts and their limit, for those who print verdicts that are known: it imports no numbers."""

AGREES, DIFFERS, CANNOT_TELL = "agrees", "differs", "cannot tell"

LIMIT = 3.0
"""Distance from which two studies differ, in standard errors of their difference."""
