"""Where slices are best placed (thesis Tables 5.1 and 5.4)."""
