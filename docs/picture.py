"""Take docs/pictures/demo.png: the head of the demo's report, in a browser.

antidrive demo && python docs/picture.py antidrive-out
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

WIDTH, HEIGHT = 1000, 1120


def main() -> None:
    """Of the report in the given folder."""
    report = Path(sys.argv[1]).resolve() / "report.html"
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.goto(report.as_uri())
        page.wait_for_function("[...document.querySelectorAll('.plot')].every(plot => plot.querySelector('svg'))")
        page.screenshot(path=str(Path(__file__).parent / "pictures" / "demo.png"))
        browser.close()


if __name__ == "__main__":
    main()
