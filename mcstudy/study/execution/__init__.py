"""Tasks of a run: on workers, and handed out to them."""
