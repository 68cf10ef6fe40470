"""BRDFs that are known along slices: layout, look-up, interpolation along highlights."""
