"""The virtual database: how it is measured, and how varied it is."""
