"""Models as data: what a file declares, what ships under a name, and their checks."""
