"""Decode messages: from bytes to points, poses and transforms."""
