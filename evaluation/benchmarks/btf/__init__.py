"""Benchmarks of BTFs."""
