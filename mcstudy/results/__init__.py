"""What Python returns: the records of the rooms below with their words, tables, figures and pages.

A record (of `gap`, `identification`, `planning`, ...) is plain data and what can be computed from it. Its class here
has the same fields and says, draws and writes them; nothing below knows how a result is shown.
"""
