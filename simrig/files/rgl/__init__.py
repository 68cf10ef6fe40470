"""Tensor files of the RGL material database, read and written."""
