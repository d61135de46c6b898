"""Makes the pictures of pages in the docs with Chromium: python -m tests.screens [--to FOLDER] [NAME ...]

With --to all pages are put into a folder, wide and narrow, light and dark, to be looked at.
"""

import argparse
import tempfile
from contextlib import chdir
from pathlib import Path

from click.testing import CliRunner
from matplotlib.figure import Figure

from skinbus.can.candump import CandumpWriter
from skinbus.cli import group
from tests.cli.simulated_presses import main as write_presses
from tests.master.rig import Rig
from tests.skin.scenes import write
from tests.view.web import pictures
from tests.view.web.browser import chromium

ROOT = Path(__file__).resolve().parents[1]

FIGURES = ROOT / "docs" / "figures"
WIDE, NARROW = 1280, 390
HEIGHTS = {"calibration": 1500, "accuracy": 1100}
"""Of the pictures on a screen; on a phone they are of its screen."""


def run(*words):
    """Run a command of skinbus."""
    result = CliRunner().invoke(group, list(map(str, words)))
    assert result.exit_code in (0, 1), result.output


def calibration(folder):
    """Make the report of a calibration from presses of which some are bad."""
    with chdir(folder):
        write_presses("presses.csv")
        run("calibrate", "pad", "presses.csv", "--out", "patch.dcf", "--report", "calibration.html")
    return Path(folder, "calibration.html")


def accuracy(_folder):
    """Make the report of the study from its table."""
    out = FIGURES / "accuracy.html"
    run("study", "report", "--table", FIGURES / "headline.csv", "--out", out)
    return out


def export_picture(out):
    """Make a picture of what is in a Parquet export: pressures of the pressed board, and contacts."""
    import pyarrow.parquet as pq

    with tempfile.TemporaryDirectory() as folder:
        log, made = Path(folder, "field.log"), Path(folder, "field.parquet")
        rig = Rig(write(Path(folder)), level="fit")
        with CandumpWriter(log) as writer:
            rig.wire.tap(writer)
            rig.run(1500)
        run("export", log, "--arm", "pad", "--out", made)
        readings = pq.read_table(made).to_pydict()
        contacts = pq.read_table(made.with_name("field.contacts.parquet")).to_pydict()
    figure = Figure((8.0, 4.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    begin = readings["t_ns"][0]
    for axes, table, key, value, unit, scale in (
        (above, readings, "tactel", "pressure_pa", "pressure, kPa", 1e-3),
        (below, contacts, "id", "force_n", "force, N", 1.0),
    ):
        for number in sorted(set(table[key])):
            rows = [k for k, other in enumerate(table[key]) if other == number]
            times = [1e-9 * (table["t_ns"][k] - begin) for k in rows]
            axes.plot(times, [scale * table[value][k] for k in rows], label=f"{key} {number}", linewidth=1.2)
        axes.set_ylabel(unit)
        axes.grid(alpha=0.3)
    below.legend(frameon=False)
    below.set_xlabel("time, s")
    above.set_title("field.parquet: readings of the 16 tactels", loc="left", fontsize=10)
    below.set_title("field.contacts.parquet: contacts as published", loc="left", fontsize=10)
    figure.savefig(out, dpi=110)


def shoot(open_tab, path, out, *, width, height, dark):
    """Make a picture of a page in a file."""
    tab = open_tab(path.as_uri(), {"width": width, "height": height}, dark=dark)
    tab.page.screenshot(path=out)
    assert tab.errors == []
    tab.page.close()


REPORTS = {"calibration": calibration, "accuracy": accuracy}
SHOTS = {
    "calibration-page-light": ("calibration", WIDE, False),
    "calibration-page-dark": ("calibration", WIDE, True),
    "calibration-page-phone": ("calibration", NARROW, False),
    "accuracy-page": ("accuracy", WIDE, False),
}
"""Pictures of reports in the docs: which, how wide, whether dark."""
EXPORT = "export-parquet"


def main(names, to):
    """Make the pictures of these names, or all."""
    shots, views, folder = SHOTS, pictures.PICTURES, FIGURES
    if to:
        folder = to
        to.mkdir(parents=True, exist_ok=True)
        sides = {"wide": WIDE, "narrow": NARROW}
        shots = {
            f"{name}-{side}-{shade}": (name, width, shade == "dark")
            for name in REPORTS
            for side, width in sides.items()
            for shade in ("light", "dark")
        }
        views = pictures.all_ways()
    wanted = names or [*shots, *views, EXPORT, *([] if to else [pictures.STORED.stem])]
    with chromium() as open_tab, tempfile.TemporaryDirectory() as temporary:
        made = {}
        for name in wanted:
            if name == pictures.STORED.stem:
                pictures.store(open_tab)
            elif name == EXPORT:
                export_picture(folder / f"{name}.png")
            elif name in views:
                pictures.make(open_tab, *views[name], folder / f"{name}.png")
            else:
                report, width, dark = shots[name]
                if report not in made:
                    made[report] = REPORTS[report](temporary)
                height = HEIGHTS[report] if width == WIDE else 844
                shoot(open_tab, made[report], folder / f"{name}.png", width=width, height=height, dark=dark)
            print(name, flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--to", type=Path)
    given = parser.parse_args()
    main(given.names, given.to)
