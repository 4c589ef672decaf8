"""The page of one diagnosis: its data, figures, tables and sections."""
