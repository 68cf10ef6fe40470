"""From pictures that a camera recorded to values: arrays in, arrays out (docs/imaging.md)."""
