"""Studies: one file per published table or figure, with its expected numbers."""
