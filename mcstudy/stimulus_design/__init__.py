"""Optimal stimuli: which powers of the lines identify the parameters best, under limits on the experiment."""
