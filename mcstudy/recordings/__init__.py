"""Recordings of experiments: their data format, reading, checking and writing. Nothing is estimated here."""
