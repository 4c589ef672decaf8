"""Bodies of the benchmark, and what they have that the model lacks: forms, geometry and simulators of their own."""
