"""Parameters of several people: means, differences and their intervals."""
