"""The main job: measure, reconstruct, render, compare, report."""
