"""The page "Fly the mesh": `python -m docs.fly.page` writes `docs/fly.html`, one file that needs no network.

Its parts are `page.html`, the scripts beside it, the report's three.js and palette, the figure, and the data of
`flight.py`. Numbers in its text are those of `facts.json`.
"""

import gzip
import json
import re
from base64 import b64encode
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from docs.fly.facts import COARSE, KEPT
from docs.fly.flight import flight
from docs.fly.tail import START, WORSE
from docs.fly.texts import DOCS

HERE = Path(__file__).parent
PAGE = DOCS / "fly.html"
# In the order in which they need each other.
SCRIPTS = ("colours.js", "method.js", "flight.js", "tail.js", "section.js", "scene.js", "page.js")


def numbers(facts: dict[str, Any]) -> dict[str, str]:
    """Return the numbers of the page's text by name."""
    tail = facts["tail"]
    return {
        "cells": f"{facts['cells']:,}",
        "few": f"{sum(START)}",
        "zero": f"{tail['zero_sites']:,}",
        "sites": f"{tail['sites']:,}",
        "angle": f"{tail['angle']:g}",
        "jump": f"{1e3 * tail['jump']:.0f}",
        "torn": f"{tail['without_box']['inverted']}",
        "sheared": f"{tail['stretched']['all']:.1f}",
        "coarse": f"{COARSE}",
        "less": f"{tail['stretched'][str(COARSE)]:.1f}",
        "worse": f"{WORSE:g}",
        "rigid": f"{facts['rigid']:.0e}",
    }


def whole(data: bytes) -> str:
    """Return the page with data of `flight`."""
    report = files("sdm_deflect.cases.report")
    facts = numbers(json.loads(KEPT.read_text(encoding="utf-8")))
    page = re.sub(r"\{(\w+)\}", lambda found: facts[found[1]], (HERE / "page.html").read_text(encoding="utf-8"))
    blocks = {
        "flight": data,
        "figure": gzip.compress((DOCS / "figures" / "method.svg").read_bytes(), 9, mtime=0),
        "proof-data": _webp(DOCS / "figures" / "method_rigid.png"),
        "library": report.joinpath("three.min.js.gz").read_bytes(),
    }
    page = page.replace("<head>", "<head>\n<!-- Made by python -m docs.fly.page from the files in docs/fly. -->", 1)
    page = page.replace("/* palette */", report.joinpath("palette.css").read_text(encoding="utf-8").strip())
    for name, block in blocks.items():
        begin = f'<script id="{name}" type="text/plain">'
        page = page.replace(begin, begin + b64encode(block).decode())
    scripts = "\n".join((HERE / name).read_text(encoding="utf-8").strip() for name in SCRIPTS)
    return page.replace('<script type="module">', f'<script type="module">\n{scripts}\n')


def _webp(path: Path) -> bytes:
    """Return a picture as WebP without loss, which has fewer bytes than a PNG."""
    packed = BytesIO()
    Image.open(path).convert("RGB").save(packed, "webp", lossless=True, quality=100, method=6)
    return packed.getvalue()


if __name__ == "__main__":
    PAGE.write_text(whole(flight()), encoding="utf-8")
