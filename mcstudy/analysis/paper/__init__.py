"""The published numbers of Goodworth & Peterka (2018) and the comparison with them."""
