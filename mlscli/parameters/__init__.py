"""Parameters: lengths, and fields that know their unit, range and meaning."""
