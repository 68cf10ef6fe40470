"""Bidirectional texture functions: stacks, grids, full, factored and sliced forms, mipmaps."""
