"""The map evaluated tile by tile: in threads, or on a cluster."""
