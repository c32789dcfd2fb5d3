"""Synthetic flights: scenes of plane rectangles, a craft that flies over them, exact truth."""
