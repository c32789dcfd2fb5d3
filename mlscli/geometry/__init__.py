"""Poses and transforms between frames, and which way is up."""
