"""Models as data: what a file declares, what ships under a name, and their checks."""

DESCRIPTIONS = {
    "two_segment": "legs and trunk, with the neural controllers of Goodworth & Peterka (2018)",
    "one_segment": "the same body with a locked hip, after Peterka (2002)",
}
"""Models that a study builds, by name."""
