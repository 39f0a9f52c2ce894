"""The few shapes of SVG that our plots need; colours follow the reader's light or dark theme."""

from __future__ import annotations

from xml.sax.saxutils import escape

_STYLE = """
text { font: 12px system-ui, sans-serif; fill: #1f2328 }
.title { font-size: 15px; font-weight: 600 }
.note { fill: #59636e; font-size: 11px }
.end { text-anchor: end } .middle { text-anchor: middle }
.paper { fill: #ffffff; stroke: #d1d9e0 }
.grid { stroke: #d1d9e0 } .base { stroke: #59636e; stroke-dasharray: 4 3 }
.ours { fill: #0969da } .limit { fill: #8250df } .peer { fill: #9aa4af }
.strong { font-weight: 600 }
@media (prefers-color-scheme: dark) {
text { fill: #e6edf3 } .note { fill: #9198a1 } .paper { fill: #0d1117; stroke: #3d444d }
.grid { stroke: #3d444d } .base { stroke: #9198a1 }
.ours { fill: #4493f8 } .limit { fill: #ab7df8 } .peer { fill: #656c76 }
}
"""


class Drawing:
    """A sheet to draw on; `kind` names classes of the style above."""

    def __init__(self, width: float, height: float, description: str) -> None:
        self._size = width, height
        self._description = description
        self._parts: list[str] = []

    def text(self, x: float, y: float, content: str, kind: str = "") -> None:
        """Write a line, its base line at `y`."""
        self._parts.append(f'<text x="{x:.1f}" y="{y:.1f}" class="{kind}">{escape(content)}</text>')

    def line(self, x1: float, y1: float, x2: float, y2: float, kind: str) -> None:
        """Draw a line."""
        self._parts.append(
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{kind}"/>'
        )

    def bar(self, x1: float, x2: float, y: float, height: float, kind: str) -> None:
        """Draw a bar between two places, whichever is left."""
        left, width = min(x1, x2), max(abs(x2 - x1), 1)
        self._parts.append(
            f'<rect x="{left:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'
            f' rx="2" class="{kind}"/>'
        )

    def render(self) -> str:
        """The file's contents."""
        width, height = self._size
        paper = f'<rect x="0.5" y="0.5" width="{width - 1:g}" height="{height - 1:g}" rx="6"'
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}"'
                f' width="{width:g}" height="{height:g}" role="img">',
                f"<title>{escape(self._description)}</title>",
                f"<style>{_STYLE}</style>",
                f'{paper} class="paper"/>',
                *self._parts,
                "</svg>\n",
            ]
        )
