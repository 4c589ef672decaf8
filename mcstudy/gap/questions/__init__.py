"""The questions a diagnosis answers, one in each file."""
