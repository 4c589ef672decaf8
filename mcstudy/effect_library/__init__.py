"""Effects that a model of stance may lack, each one declaration: what it changes, how large it can be, how it shows."""
