"""What the project is made with: dependencies, pinned, and the list of them for those who audit."""
