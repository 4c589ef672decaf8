"""One person in several conditions: one fit, in which parameters are shared or have a value in each condition."""
