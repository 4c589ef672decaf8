"""A benchmark of diagnoses with hidden causes: `make` cases, `answer` them without the key, `score` with the key."""
