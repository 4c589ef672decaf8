"""Fits of the model, with and without effects, to the lines of a recording."""
