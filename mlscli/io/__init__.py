"""Files and messages: what recordings are read from, and what is written."""
