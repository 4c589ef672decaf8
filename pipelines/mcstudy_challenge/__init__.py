"""The benchmark of the diagnosis: recordings with hidden causes, answers and scores, attached to mcstudy."""
