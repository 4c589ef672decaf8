"""Questions asked of a cube: accuracy, convergence, sensitivity."""
