"""What each effect really changes in a picture."""
