"""The web experiment and the viewer: servers on this machine, and the pages that they show."""
