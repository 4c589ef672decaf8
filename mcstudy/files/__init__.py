"""Safe reading and writing of files: written completely or not at all; checked, and refused with a one-line error."""
