"""From recordings to maps: batches, the size of cells, one pass or many, in memory or on disk."""
