"""What every room stands on: errors, arrays, the backend, cost, colour, effects, random numbers."""
