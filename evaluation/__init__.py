"""Metrics, comparisons, studies, benchmarks and the report."""

if __name__ != "simrig.evaluation":  # a second copy of the modules would be made
    raise ImportError("import this package as 'simrig.evaluation', not as 'evaluation'")
