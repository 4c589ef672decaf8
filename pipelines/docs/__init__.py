"""The documentation site: ``python -m pipelines.docs`` builds it into build/site."""
