"""A benchmark of diagnoses on withheld causes: `make` cases, `answer` them without the key, `score` with it."""
