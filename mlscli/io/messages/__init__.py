"""Messages: from bytes to points, poses and transforms."""
