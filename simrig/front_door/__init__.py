"""What ``import simrig`` offers: one function for each step of the flow, over the rooms."""
