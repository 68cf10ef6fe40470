"""From exported answers to distances, fits, correlations and figures."""
