"""Maps to look at: a page for the browser, a window on a desktop, a replay of the flight."""
