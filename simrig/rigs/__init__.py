"""Virtual rigs: what a measuring device would record, and what that costs."""
