"""Accuracy per second in rendering."""
