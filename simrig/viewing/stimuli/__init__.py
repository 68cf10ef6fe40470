"""The stimuli of the thesis's experiments."""
