"""The results cube on disk: layout, chunks, checksums, metadata, and what keeps them right."""
