"""From a recording to frequency lines whose labels are settled, and the fit of the base model to them."""
