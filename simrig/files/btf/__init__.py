"""Readers and writers of BTFs."""
