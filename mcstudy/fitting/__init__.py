"""Fitting a model to FRFs: cost functions, starts, the compiled kernel and the solvers."""
