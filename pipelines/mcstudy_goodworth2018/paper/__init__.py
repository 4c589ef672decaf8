"""What the paper published, and the value of a study for each of its statements."""
