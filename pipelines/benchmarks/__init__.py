"""Speed and quality of the fits compared with other packages, and the cost of a study.

``python -m pipelines.benchmarks`` runs them.
"""
