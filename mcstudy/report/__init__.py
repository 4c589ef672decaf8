"""The page a researcher shows, and its figures as functions that return matplotlib axes."""
