"""The page of a study: what it shows, in words, tables and figures."""
