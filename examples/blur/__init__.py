"""Pictures of a triangle integrated over time (motion blur) and over a lens (depth of field)."""
