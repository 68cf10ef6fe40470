"""Plans: where to measure."""
