"""From recordings to maps: batches, the size of cells, maps in memory and on disk."""
