"""The commands of ``simrig btf``."""
