"""The rig that takes registered pictures of a tile with structure."""
