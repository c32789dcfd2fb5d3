"""Files and messages: read recordings, write maps, meshes and flights."""
