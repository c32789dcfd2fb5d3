"""A map as a notebook shows it: a picture from above, and what it holds in numbers."""

from __future__ import annotations

from base64 import b64encode
from html import escape

from mlscli.maps.summary import describe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.words import some


def html_of(surface: SurfaceMap) -> str:
    """Return a map as HTML, complete in itself."""
    told = describe(surface)
    patches, extent = told["patches"], told["extent"]
    rows = {
        "patches": f"{patches['total']:,}: {patches['measured']:,} measured, "
        f"{patches['plastered']:,} plastered, {patches['artificial']:,} artificial; "
        f"{patches['vertical']:,} vertical",
        "levels": ", ".join(
            f"{some(cells, 'cell')} with {number}" for number, cells in told["levels"].items()
        ),
        "extent": "; ".join(
            f"{axis} {low:.6g} to {high:.6g}" for axis, (low, high) in (extent or {}).items()
        ),
        "cell size": f"{surface.cell_size:.6g}",
        "frame": surface.frame_id,
    }
    cells = "".join(
        f'<tr><th style="text-align:left">{name}</th>'
        f'<td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in rows.items()
        if text
    )
    return f"<div>{_image(surface)}<table>{cells}</table></div>"


def _image(surface: SurfaceMap) -> str:
    if not surface.size:
        return ""
    from mlscli.plot.above import plot_above
    from mlscli.plot.picture import png

    picture = b64encode(png(plot_above(surface))).decode()
    return f'<img alt="the map from above" src="data:image/png;base64,{picture}"/>'
