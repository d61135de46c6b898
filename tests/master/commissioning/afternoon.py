"""From bare boards to contacts: a person and a robot on the virtual clock, with the commands in their order.

``python -m tests.master.commissioning.afternoon 24`` prints the steps, the simulated minutes and the errors.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.can.virtual_bus import VirtualBus
from skinbus.cli import group
from skinbus.cli.commands.assign import wanted_by
from skinbus.cli.press_csv import reading_cells, reading_columns
from skinbus.config.arm_edit import write_arm
from skinbus.config.arm_file import read_arm_file
from skinbus.config.system import load_arm
from skinbus.estimate.presses.single_noise import mean_and_noise
from skinbus.master import Master
from skinbus.master.commissioning.identification import Identification
from skinbus.master.commissioning.node_id_assignment import Assigner
from skinbus.master.commissioning.scan import Scanner
from skinbus.master.commissioning.unplaced_boards import (
    QuietMaster,
    changes_of,
    places_of,
    unplaced,
    wanted_numbers,
    with_numbers,
)
from skinbus.node.lss import UNCONFIGURED, Lss, Mode
from skinbus.node.nmt import nmt_frame
from skinbus.objects import cia
from skinbus.sim import World
from skinbus.sim.effects.gain_spread import GainSpread
from skinbus.sim.effects.noise import Noise
from skinbus.sim.effects.offset import Offset
from tests.master.commissioning.person import FORCE_N, Person, mounted, pressed_scene
from tests.master.rig import Stranger

MS = 1_000_000
AROUND = 8
CORNERS = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 0), (-1, 0)]
"""Of the presses that locate a board, in 17 mm."""
N_PRESSES = 54
"""On each board, anywhere, for its law and gains; with the corners 60, the least that the docs ask for."""
FALSE_M = 10e-3
"""From a press, where its contact cannot be."""
QUIET_MS = 10_000
"""After a start in which nothing touches the skin."""
PLACE_SD = 0.3e-3
"""m, of the robot's tool."""


def plan(folder, n):
    """The arm file of a cylinder with n boards, in rings of eight."""
    rings = -(-n // AROUND)
    text = '# the plan\n[arm]\nname = "new arm"\nrate_hz = 20.0\n[[link]]\nname = "forearm"\n'
    text += f'surface = "cylinder"\nlength_mm = {62 * rings + 10}.0\nradius_mm = 79.0\n'
    for k in range(rings):
        count = min(AROUND, n - AROUND * k)
        text += f'# ring {k + 1}\n[[ring]]\nlink = "forearm"\ns_mm = {36.0 + 62 * k}\ncount = {count}\n'
        text += f"first_node_id = {1 + AROUND * k}\n"
    path = Path(folder) / "arm.toml"
    path.write_text(text)
    return path


class Afternoon:
    """The bus with boards that nobody has configured, and what a person does; ``notes`` are its steps."""

    def __init__(self, folder, n, seed, n_presses=N_PRESSES):
        self.path = plan(folder, n)
        self.n_anywhere = n_presses
        planned = load_arm(self.path)
        self.true, self.mirrored = mounted(planned, seed, place_mm=1.7, n_mirrored=1)
        effects = [Noise(), Offset(sigma_pa=300.0), GainSpread(sigma=0.05)]
        self.scene = pressed_scene(self.true, effects)
        self.seed = seed
        self.rng, self.person = np.random.default_rng(seed + 1), Person(self.true, seed + 2)
        self.world = World(self.scene)
        self.wire = VirtualBus(planned.bus.bitrate)
        self.wire.attach(self.world)
        self.stranger = Stranger()
        self._port = self.wire.attach(self.stranger)
        self.notes, self.n_presses = [], 0
        self.pass_ms(200)
        self._unconfigure()

    def pass_ms(self, ms):
        self.wire.run(self.wire.now_ns + round(ms * MS))

    def note(self, what):
        self.notes.append(f"{self.wire.now_ns / 60e9:5.1f} min  {what}")

    def _say(self, *frames):
        self.stranger.waiting += frames
        self.wire.wake(self._port)
        self.pass_ms(20)

    def _unconfigure(self):
        """As boards leave the factory: no node-ID."""

        def lss(command, *data):
            return Frame(cia.LSS_MASTER_ID, bytes([command, *data]).ljust(8, b"\0"))

        self._say(lss(Lss.SWITCH_GLOBAL, Mode.CONFIGURATION.value))
        self._say(lss(Lss.CONFIGURE_NODE_ID, UNCONFIGURED), lss(Lss.STORE))
        self._say(
            lss(Lss.SWITCH_GLOBAL, Mode.WAITING.value), nmt_frame(cia.NmtCommand.RESET_COMMUNICATION, 0)
        )
        self.pass_ms(100)
        assert {device.node_id for device in self.world.devices} == {UNCONFIGURED}

    def run(self, core):
        """Run a core until it has ended."""
        events = []
        port = self.wire.attach(core, on_event=events.append)
        while not any(event.kind == EventKind.STOP for event in events):
            self.pass_ms(20)
        self.wire.detach(port)
        return core

    def press(self, point, force, ms):
        self.n_presses += 1
        self.scene.plan.touches = [(*point, force)]
        self.pass_ms(ms)

    def release(self, ms):
        self.scene.plan.touches = []
        self.pass_ms(ms)

    def identify(self):
        """`skinbus identify ARM --assign`"""
        arm, mountings = load_arm(self.path), read_arm_file(self.path).mountings
        known, free, hints = wanted_by(arm)
        given = self.run(Assigner(known=known, free=free, hints=hints)).results
        assert all(result.outcome.is_good for result in given)
        self.note(f"{len(given)} boards have a node-ID")
        bench = unplaced(self.run(Scanner()).nodes.values(), arm)
        dialogue, lines = Identification(places_of(arm, mountings), bench.boards), []
        master = QuietMaster(bench.arm, lambda t_ns, pressures: lines.extend(dialogue.step(t_ns, pressures)))
        port = self.wire.attach(master)
        self.pass_ms(2000)
        while not dialogue.is_complete:
            self.press(self.person.aim(lines[-1]), FORCE_N, 600)
            self.release(400)
        self.wire.detach(port)
        self._say(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, 0))
        self.note(f"{len(dialogue.found)} boards identified by {self.n_presses} presses")
        results = self.run(Assigner(known=wanted_numbers(dialogue.found, mountings))).results
        found = with_numbers(dialogue.found, results)
        new = frozenset(result.node_id for result in given)
        write_arm(self.path, self.path, changes_of(mountings, found, new_numbers=new))
        self.note("node-IDs are those of the plan")
        assert [device.node_id for device in self.world.devices] == arm.node_id.tolist()

    def master(self, arm):
        """A master at work, its zeros known: near a threshold they take some windows of half a second."""
        self.reports = []
        self._master_port = self.wire.attach(Master(arm, level="fit", on_cycle=self.reports.append))
        self.pass_ms(QUIET_MS)

    def robot_presses(self, points_of, force):
        """Presses on every board at points (x, y) about its planned centre; rows of a table."""
        arm = load_arm(self.path)
        self.master(arm)
        rows = []
        for p, placed in enumerate(arm.patches):
            surface = arm.links[placed.link].surface
            for x, y in points_of(p):
                at = np.array([placed.s + x, y])
                s, a = surface.undevelop(*at, placed.a)
                said = surface.undevelop(*(at + PLACE_SD * self.rng.standard_normal(2)), placed.a)
                self.press((placed.link, float(s), float(a)), force, 150)
                first = len(self.reports)
                self.pass_ms(200)
                here = arm.tactels_of(p)
                cycles = np.array([r.pressures for r in self.reports[first:]])[:, here]
                readings = reading_cells(*mean_and_noise(cycles), arm.tactel_gain[here], cycles.shape[1])
                rows.append((placed.node_id, *(1e3 * np.array(said)), force, *readings))
                self.release(100)
        self.wire.detach(self._master_port)
        self._say(nmt_frame(cia.NmtCommand.PRE_OPERATIONAL, 0))
        return rows

    def table(self, name, rows):
        path = self.path.with_name(name)
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["node_id", "s_mm", "a_mm", "force_n", *reading_columns(16)])
            writer.writerows(rows)
        return path

    def command(self, *words, statuses=(0,)):
        result = CliRunner().invoke(group, list(map(str, words)), catch_exceptions=False)
        assert result.exit_code in statuses, result.output
        return result.output

    def press_all(self):
        """A robot presses every board near its corners and anywhere."""
        before = self.n_presses
        corners = [(17e-3 * x, 17e-3 * y) for x, y in CORNERS]
        rows = self.robot_presses(
            lambda p: [*corners, *self.rng.uniform(-20e-3, 20e-3, (self.n_anywhere, 2))], 5.0
        )
        self.presses = self.table("presses.csv", rows)
        self.note(f"{self.n_presses - before} presses by a robot")

    def locate(self):
        """`skinbus locate ARM --presses presses.csv --write`"""
        self.command("locate", self.path, "--presses", self.presses, "--write")
        self.note("boards located")

    def calibrate(self):
        """`skinbus calibrate ARM presses.csv --out boards.dcf`, and the files into the arm file"""
        out = self.path.with_name("boards.dcf")
        self.command("calibrate", self.path, self.presses, "--out", out)
        mountings = read_arm_file(self.path).mountings
        write_arm(self.path, self.path, {m.key: {"eds": f"boards-{m.node_id}.dcf"} for m in mountings})
        self.note("boards calibrated")

    def errors(self, n_each):
        """Place errors of contacts under the same presses each time, m; nothing was learned from them."""
        arm = load_arm(self.path)
        self.master(arm)
        rng, errors = np.random.default_rng(self.seed + 3), []
        self.false = []
        for placed in self.true.patches:
            surface = self.true.links[placed.link].surface
            for x, y in rng.uniform(-17e-3, 17e-3, (n_each, 2)):
                s, a = surface.undevelop(placed.s + x, y, placed.a)
                self.press((placed.link, float(s), float(a)), 5.0, 300)
                contacts = self.reports[-1].contacts
                self.release(300)
                off = np.array(surface.distance(s, a, contacts.s, contacts.a))
                errors.append(float(off.min(initial=np.inf)))
                for c in np.flatnonzero(off > FALSE_M):
                    where = f"node {arm.node_id[contacts.patch[c]]}, {1e3 * off[c]:.0f} mm off"
                    self.false.append(f"{where}, {contacts.force[c]:.1f} N, quality {contacts.quality[c]}")
        self.wire.detach(self._master_port)
        self.note(f"{len(errors)} contacts measured, {len(self.false)} where nothing pressed")
        self.notes += [f"           {false}" for false in self.false]
        return np.array(errors)


def spend(folder, n, seed, n_each=2):
    """Return the afternoon and the errors of place after each step (m), at so many presses on each board."""
    day = Afternoon(folder, n, seed)
    errors = {}
    day.identify()
    errors["identified"] = day.errors(n_each)
    day.press_all()
    day.locate()
    errors["located"] = day.errors(n_each)
    day.calibrate()
    day.locate()  # by the laws of the boards, which are known now
    errors["calibrated"] = day.errors(n_each)
    return day, errors


if __name__ == "__main__":
    n_boards = int(sys.argv[1]) if len(sys.argv) > 1 else 24
    first_seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with tempfile.TemporaryDirectory() as where:
        done, left = spend(where, n_boards, first_seed)
    print("\n".join(done.notes))
    for step, own in left.items():
        print(f"{step}: {1e3 * np.sqrt(np.mean(own**2)):.2f} mm RMS, at most {1e3 * own.max():.2f} mm")
