"""The commands, one module each: options in, library calls, a report out."""
