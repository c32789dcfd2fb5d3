"""Maps of one place in different frames: how the one lies in the frame of the other."""
