"""The map: its cells and patches, and how maps are stored, merged and changed."""
