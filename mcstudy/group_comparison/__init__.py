"""What differs between two groups of people: detection, place, cause, and how much of the difference a cause closes."""
