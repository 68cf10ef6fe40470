"""BRDFs that are tables: dense, isotropic, RGL's, scattered samples, and how tables are packed."""
