"""The tables of `mcstudy show`, as data and as text."""

SCHEMA = "show"
"""Name of the schema of the tables."""
