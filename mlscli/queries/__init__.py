"""What a map says of places: levels, heights, and the space between them."""
