"""Thesis Table 5.2: slices beside barycentric interpolation and splines."""
