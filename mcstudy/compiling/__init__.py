"""Compiled functions, kept on disk: decorators, and the one module that knows private parts of numba."""
