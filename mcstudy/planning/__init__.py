"""Planning backwards: the cheapest design of an experiment whose estimates are as precise as wanted."""
