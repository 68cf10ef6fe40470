"""Study: how well the true plane of a surface is found from pictures."""
