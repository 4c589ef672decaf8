"""What many starts find: the starts that a fit needs, and the local minima."""
