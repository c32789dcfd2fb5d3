"""Maps to look at: a page for the browser, and a window on a desktop."""
