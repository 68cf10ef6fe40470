"""Studies of the gantry (thesis section 6)."""
