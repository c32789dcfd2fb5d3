"""Write maps, meshes and flights, each whole or not at all."""
