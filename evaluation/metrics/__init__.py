"""Differences between pictures and between BRDFs."""
