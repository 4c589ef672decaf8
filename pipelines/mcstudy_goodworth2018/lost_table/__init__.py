"""What the numbers printed in Goodworth & Peterka (2018) tell about its lost Table I: an inference, not the table."""
