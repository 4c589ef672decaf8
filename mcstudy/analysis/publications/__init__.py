"""Comparison of a study with published numbers: statements, verdicts, and the publications that are installed."""
