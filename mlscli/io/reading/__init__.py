"""From files and messages to keyframes in the map frame."""
