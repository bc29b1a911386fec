"""Make the README's pictures of the reports here: ``.venv/bin/python -m docs.pictures``."""

import io
import sys
from pathlib import Path

from PIL import Image, ImageOps

from tests.report.browser import Page, find_browser, in_browser

REPORTS = Path(__file__).parents[1] / "reports"
PICTURES = REPORTS / "pictures"

# name, page, width and height [px], dark, print, the element that is at the top
SHOTS = (
    ("report", "cubic", 1000, 1560, False, "", "header"),
    ("phone", "quintic", 360, 760, False, "", "header"),
    ("dark", "coulomb", 1000, 760, True, "", "#equivalent"),
    ("print", "bilinear", 700, 760, False, "print", "#laws"),
)
COLOURS = 256


async def shoot(page: Page) -> dict[str, bytes]:
    """Return the pictures as PNG files, by name."""
    pictures = {}
    for name, case, width, height, dark, media, top in SHOTS:
        await page.show((REPORTS / case / "report.html").as_uri(), width, height, dark=dark, media=media)
        place = await page.ask(f"Math.round(document.querySelector('{top}').getBoundingClientRect().top)")
        image = Image.open(io.BytesIO(await page.picture())).convert("RGB")
        image = image.crop((0, place, width, place + height))
        if media:
            # the paper has a margin, which a screen does not show
            image = ImageOps.expand(image, 40, "white")
        file = io.BytesIO()
        # few colours: the pages have few, and the repository keeps every version of a picture
        image.quantize(COLOURS, dither=Image.Dither.NONE).save(file, "png", optimize=True)
        pictures[name] = file.getvalue()
    return pictures


def main() -> None:
    """Write one file a picture of reports that `make reports` made."""
    if (browser := find_browser()) is None:
        sys.exit("no chromium here")
    PICTURES.mkdir(exist_ok=True)
    for name, content in in_browser(browser, shoot).items():
        (PICTURES / f"{name}.png").write_bytes(content)
        print(f"reports/pictures/{name}.png: {len(content)} bytes")


if __name__ == "__main__":
    main()
