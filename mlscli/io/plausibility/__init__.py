"""Whether data is what its header claims: pure functions on small samples, for all readers."""
