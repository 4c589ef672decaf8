"""The alternatives that the paper discusses: one segment, two stimuli without a model, fits to a population's mean."""
