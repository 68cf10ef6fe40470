"""A BTF beside the structure it was measured from."""
