"""The plan that looks first: a pilot describes the material, batches go where errors would show."""
