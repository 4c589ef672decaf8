"""What could be missing: effects of the library, an unknown term at one location, an unstructured residual."""
