"""What an instrument is, in numbers."""
