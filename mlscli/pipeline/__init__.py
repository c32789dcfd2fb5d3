"""The stages, and the builder that runs them: points and maps, nothing of files."""
