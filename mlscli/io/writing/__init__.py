"""What is written, whole or not at all: maps, meshes, and flights."""
