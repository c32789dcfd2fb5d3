"""Keyframes, and batches of them: what recordings become, and what the pipeline takes."""
