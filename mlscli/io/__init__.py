"""Files and messages: what recordings are read from, and what maps are written to."""
