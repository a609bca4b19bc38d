"""The support set on disk."""
