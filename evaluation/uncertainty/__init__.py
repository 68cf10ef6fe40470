"""The uncertainty budget of an instrument: what each of its numbers does to a measured value."""
