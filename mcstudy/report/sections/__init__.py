"""Figures of the page by family: which panels, which words, which numbers."""
