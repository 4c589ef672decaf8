"""The physics of stance: body, feedback, stimulus, noise and simulation. No files, no scheduler."""
