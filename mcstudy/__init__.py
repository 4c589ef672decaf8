"""Monte Carlo studies of identifiability, and diagnosis of the gap between model and body."""
