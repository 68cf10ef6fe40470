"""Rigs that evaluate f_r where they would look."""
