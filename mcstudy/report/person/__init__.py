"""The page of one fit: its figures, tables and sections."""
