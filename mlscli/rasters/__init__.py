"""Maps as rasters: layers by cell, and where a robot can drive or fly."""
