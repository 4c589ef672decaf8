"""How precise a search needs to be; without NumPy, because tables are printed without it."""

WANTED = 0.01
"""Chance of a missed minimum below which no more starts are drawn."""
