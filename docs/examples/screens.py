"""Pictures of a report's page for the guide, as a browser shows it: `python docs/examples/screens.py docs/figures`.

It needs Playwright and Chromium. `screens.txt` says of which sources the pictures are.
"""

import shutil
import subprocess
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parents[2]
# What a page looks like depends on these files in `cases/report`.
SOURCES = ("palette.css", "style.css", "page.html", "picture.html", "viewer.js")
SWITCHES = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
DEFLECT = (
    "deflect naca.su2 --surface flap --fixed wing --hinge 0.7,0.6,0 0.7,1.4,0 --angle 15 --motion blended "
    "--slide symmetry:plane --quiet"
)


def digest() -> str:
    """Return what identifies the sources of the pictures."""
    content = b"".join((ROOT / "cases" / "report" / name).read_bytes() for name in SOURCES)
    return sha256(content).hexdigest()


def at_nine_degrees(tab: Any) -> None:
    """Type 9 degrees, and unfold the curves over the range."""
    tab.locator("#scene-typed-flap").fill("9")
    tab.locator("#scene-typed-flap").press("Enter")
    tab.click("text=Range:")


PICTURES: dict[str, tuple[Callable[[Any], object], str]] = {
    "report_turnable": (lambda tab: None, ""),
    "view": (at_nine_degrees, ""),
    "report_verdict": (lambda tab: tab.locator("#verdict-table").scroll_into_view_if_needed(), "#verdict-table"),
}


def main(folder: Path) -> None:
    """Deflect the half wing of `sdm example`, and write the pictures of its report into a folder."""
    from playwright.sync_api import sync_playwright

    with TemporaryDirectory() as scratch, sync_playwright() as playwright:
        for words in (["example"], DEFLECT.split()):
            subprocess.run([sys.executable, "-m", "sdm_deflect", *words], cwd=scratch, check=True)
        path = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = playwright.chromium.launch(executable_path=path, args=SWITCHES)
        for name, (prepare, part) in PICTURES.items():
            tab = browser.new_page(viewport={"width": 1280, "height": 800})
            tab.goto((Path(scratch) / "naca-deflected-report" / "report.html").as_uri())
            tab.wait_for_selector("#turnable[data-state=deflected]")
            prepare(tab)
            tab.wait_for_timeout(1000)
            (tab.locator(part) if part else tab).screenshot(path=folder / f"{name}.png")
        browser.close()
    (folder / "screens.txt").write_text(f"{digest()}\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
