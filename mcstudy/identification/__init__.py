"""Parameters of one person from a recording: the best fit, how sure it is, and intervals that hold the truth.

Data take one way: measured lines, `minimum` (the best of many starts), `correction` (what the estimated noise adds to
the uncertainty), `profile` (intervals by likelihood ratio), `result` (what a person reads). Nothing here uses a prior:
what the data do not determine is said to be undetermined.
"""
