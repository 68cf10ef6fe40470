"""The web experiment: design, server, export, analysis, and virtual observers that take part."""
