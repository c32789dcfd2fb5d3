"""The map: cells, patches, what maps are put together from, and how they grow."""
