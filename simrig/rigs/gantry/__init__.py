"""The gantry: lights and cameras on two arms."""
