"""Keyframes, which recordings are read as, and batches of them, which the pipeline takes."""
