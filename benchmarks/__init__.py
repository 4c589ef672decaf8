"""Speed and quality of the fits beside their peers, and what a study costs: ``python -m benchmarks``."""
