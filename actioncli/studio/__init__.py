"""Local pages: the support set and what was recorded, for those who would rather click."""
