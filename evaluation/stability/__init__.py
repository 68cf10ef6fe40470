"""The hard cases over everything that computes, in every precision (docs/stability.md)."""
