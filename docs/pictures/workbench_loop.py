"""Animated picture of the workbench: budget, fit, where it fails, diagnosis, the error falls.

example: ros2 run power_lab challenge --seed 66 -o bags/riddle
         python docs/pictures/workbench_loop.py bags/riddle -o workbench_loop.webp
"""

import argparse
import io
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from wattwalk_core.command import command
from wattwalk_core.errors import InputError
from wattwalk_core.processes import ChildProcess

WIDTH, HEIGHT, STRIP = 1180, 760, 44  # pixels of the page, and of the sentence above it
SHOWN = 900  # pixels, width of the picture
HOLD, FADE, FADES = 2600, 70, 4  # ms, ms, frames
KNOWN = ('viscous friction', 'Coulomb friction', 'rotor inertia')
PATIENCE = 300_000  # ms
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome')
PROGRAM = 'from power_workbench.commands.arguments import open; raise SystemExit(open())'


def scenes(page: Any) -> Iterator[tuple[str, str]]:
    """Walk the loop; yield a sentence and the element that is to be seen with it."""
    page.locator('#plot-efficiency .main-svg').first.wait_for()
    yield 'A recording, opened: where its power goes', '#summary'
    for effect in KNOWN:
        page.locator('label.choice', has_text=effect).first.click()
    yield 'A first model of the effects that one is sure of', '#model'
    page.get_by_role('button', name='Fit', exact=True).click()
    page.locator('#plot-map .main-svg').first.wait_for()
    yield 'Measured against model, the error below', '#traces'
    page.locator('#regimes button').first.click()
    page.locator('#selection').wait_for()
    yield 'Where it fails, in words and on a map', '#where'
    page.get_by_role('button', name='Find what is missing').click()
    page.locator('#verdict').wait_for()
    yield 'The verdict, and the next step as one button', '#summary'
    page.locator('.candidate').first.hover()
    page.locator('#plot-traces').get_by_text('error with').first.wait_for()
    page.locator('#next-step').click()
    page.locator('#stairs-words', has_text='From').wait_for()
    yield 'Added: the error falls', '#stairs'


def still(page: Any, sentence: str, element: str) -> Any:
    """The page about an element, with a sentence above it."""
    from matplotlib import get_data_path
    from PIL import Image, ImageDraw, ImageFont

    page.evaluate(
        'place => document.querySelector(place).scrollIntoView({behavior: "instant"})', element
    )
    page.wait_for_timeout(700)
    shot = Image.open(io.BytesIO(page.screenshot())).convert('RGB')
    out = Image.new('RGB', (WIDTH, HEIGHT + STRIP), '#1b1f24')
    out.paste(shot, (0, STRIP))
    font = ImageFont.truetype(f'{get_data_path()}/fonts/ttf/DejaVuSans-Bold.ttf', 22)
    ImageDraw.Draw(out).text((18, 9), sentence, 'white', font)
    return out.resize((SHOWN, round(SHOWN * (HEIGHT + STRIP) / WIDTH)), Image.Resampling.LANCZOS)


def walk(bag: Path) -> list[Any]:
    """Stills of the whole loop in a browser of this machine."""
    from playwright.sync_api import sync_playwright

    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise InputError(f'the picture needs a browser, one of {", ".join(BROWSERS)}')
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        words = [sys.executable, '-c', PROGRAM, str(bag), '--no-browser', '--port', '0']
        words += ['--folder', str(folder / 'workbench')]
        with ChildProcess(words, folder / 'open.log') as server, sync_playwright() as running:
            made = running.chromium.launch(executable_path=browser, args=['--no-sandbox'])
            page = made.new_page(viewport={'width': WIDTH, 'height': HEIGHT})
            page.set_default_timeout(PATIENCE)
            page.goto(server.wait_for_line(r'(http://[\w.:/?=-]+)', 120)[1])
            stills = [still(page, *scene) for scene in scenes(page)]
            made.close()
            server.interrupt()
            server.wait()
    return stills


@command
def main(args: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('bag', type=Path, metavar='BAG')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='F.webp')
    options = parser.parse_args(args)

    from PIL import Image

    stills = walk(options.bag)
    frames, times = [], []
    for here, there in zip(stills, [*stills[1:], stills[0]], strict=True):
        frames.append(here)
        times.append(HOLD)
        for step in range(1, FADES):
            frames.append(Image.blend(here, there, step / FADES))
            times.append(FADE)
    first, *rest = frames
    first.save(
        options.output,
        save_all=True,
        append_images=rest,
        duration=times,
        loop=0,
        quality=50,
        method=4,
        kmin=FADES - 1,
        kmax=FADES,  # a key frame for each still: else traces of the last one stay
    )
    print(f'{options.output}: {options.output.stat().st_size / 1e6:.2f} MB')


if __name__ == '__main__':
    main()
