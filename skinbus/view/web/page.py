"""The web page: a viser server on this machine that shows what a follower has, at the pace of the eye."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import viser
import viser.uplot

from skinbus.errors import SkinbusError
from skinbus.model import Arm
from skinbus.skin.blind import Coverage, coverage_of
from skinbus.skin.bus_recorder import BusRecorder
from skinbus.skin.cycle import Cycle
from skinbus.skin.pressed import PressedLoads
from skinbus.view.web import colours, panels
from skinbus.view.web.drawing import Drawer, Drawing
from skinbus.view.web.follower import Follower
from skinbus.view.web.playback import Playback
from skinbus.view.web.player import FilmPlayer
from skinbus.view.web.poses import RobotPoses, in_a_row, placed
from skinbus.view.web.server import Server
from skinbus.view.web.stage import StageNodes

DRAW_S: Final = 0.05
"""Between two pictures: twenty a second."""
PANEL_S: Final = 0.5
"""Between two updates of the panels: what can be read."""
SERIES: Final = ("#e8590c", "#1971c2", "#2f9e44", "#9c36b5", "#e03131", "#0c8599")
"""Of the contacts in the plot of forces: colours that can be distinguished."""
HERE: Final = "127.0.0.1"
LEAST_TURN: Final = 1e-3
"""Change of a joint position, rad or m, from which on the links are drawn elsewhere: less is not seen."""
BLIND_LIFT: Final = 1.2e-3
"""Of points of blind areas over the surface, m: over boards and tactels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How the page is served."""

    host: str = HERE
    port: int = 8080
    dark: bool = False


class Page:
    """Shows an arm until it is stopped."""

    def __init__(
        self,
        arm: Arm,
        follower: Follower | FilmPlayer,
        title: str,
        settings: Settings,
        recorder: BusRecorder | None = None,
    ) -> None:
        """Serve.

        follower: has the cycles that are shown
        title:    of the source, for people
        recorder: of its buses, where it has some

        Raises:
            ConfigError: faults of the robot's URDF.
        """
        self._arm = arm
        self._robot = RobotPoses(arm) if arm.robot is not None else None
        poses = self._robot.at(None) if self._robot else in_a_row(arm)
        self._positions: npt.NDArray[np.float64] | None = None
        self._follower = follower
        self._recorder = recorder
        self._title = title
        self._drawer = Drawer(arm, poses)
        self._pressed = PressedLoads(arm)
        self._dark = settings.dark
        self.server = server = Server(settings.host, settings.port)
        self.stage = StageNodes(server, arm, poses)
        self.n_drawn = 0
        self.drawing: Drawing | None = None
        """What was drawn last."""
        self._note = poses.note
        self._ids: list[int] = []
        self._is_changed = False
        self._coverage: Coverage | None = None
        self._panel_s = 0.0
        self._stop = threading.Event()
        self._build()

    @property
    def port(self) -> int:
        """Where it is served."""
        return self.server.get_port()

    @property
    def clients(self) -> dict[int, viser.ClientHandle]:
        """Pages that are open, by the numbers that viser gives them."""
        return self.server.get_clients()

    def run(self, seconds: float | None = None, is_over: Callable[[], bool] = lambda: False) -> None:
        """Draw until ``stop`` is called or ``is_over``, or for so long."""
        end = time.monotonic() + seconds if seconds is not None else float("inf")
        last = time.monotonic()
        while not (self._stop.is_set() or is_over()) and time.monotonic() < end:
            begun = time.monotonic()
            if isinstance(self._follower, FilmPlayer):
                self._follower.advance(begun - last)
            last = begun
            self.update()
            self._stop.wait(max(DRAW_S - (time.monotonic() - begun), 0.0))

    def stop(self) -> None:
        """End ``run``."""
        self._stop.set()

    def close(self) -> None:
        """End the server."""
        with redirect_stdout(StringIO()):
            self.server.stop()

    def update(self) -> None:
        """Draw the newest cycle, where it is new, and the panels when it is their time."""
        cycle, now = self._follower.newest, time.monotonic()
        if cycle is not None:
            self._move(cycle)
            drawing = self._drawer.draw(cycle, age_s=self._follower.silent_s)
            if drawing.is_unlike(self.drawing) or self._is_changed:
                self._is_changed = False
                with self.server.atomic():
                    self.stage.show(
                        drawing,
                        labels=self._labels.value,
                        trails=self._trails.value,
                        truth=self._truth.value,
                    )
                self.n_drawn += 1
                self.drawing = drawing
        if now - self._panel_s >= PANEL_S:
            self._panel_s = now
            self._show_panels(cycle)

    def _move(self, cycle: Cycle) -> None:
        """Bring the links to the joint positions of a cycle, where it has some."""
        if self._robot is None:
            return
        q = cycle.joint_positions
        known = q if len(q) and np.isfinite(q).all() else None
        before = self._positions
        if known is None or (before is not None and np.abs(known - before).max() < LEAST_TURN):
            return
        self._positions = known.copy()
        poses = self._robot.at(known)
        self._note = poses.note
        self._drawer.move(poses)
        self.stage.move(poses)

    def _build(self) -> None:
        """Make the panels."""
        gui = self.server.gui
        self._theme(self._dark)
        gui.set_panel_label("skinbus")
        gui.main_panel.dock_right()
        self._head = gui.add_html("")
        self._legend = gui.add_html(panels.legend())
        self._playback = (
            Playback(self.server, self._follower) if isinstance(self._follower, FilmPlayer) else None
        )
        if self._playback is None:
            self._add_zeros()
        if self._recorder is not None:
            self._add_recorder(self._recorder)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Forces"):
            self._forces = self._plot("force, N, over the last 20 s")
        with tabs.add_tab("Loads"):
            self._loads = gui.add_html("")
        with tabs.add_tab("Boards"):
            self._boards = gui.add_html("")
        with tabs.add_tab("Cycle"):
            self._cycle = gui.add_html("")
        with tabs.add_tab("Show"):
            self._labels = gui.add_checkbox("Ids and forces", True)
            self._trails = gui.add_checkbox("Trails of 2 s", True)
            self._board_loads = gui.add_checkbox("Loads of boards", False)
            self._truth = gui.add_checkbox("Truth of a scene, contacts of a recording", True)
            full = gui.add_slider("Brightest, kPa", 5.0, 250.0, 5.0, colours.FULL_KPA)
            blind = gui.add_checkbox("Blind areas", False)
            least = gui.add_slider("Blind: does not feel, N", 0.2, 5.0, 0.1, 1.0)
            dark = gui.add_checkbox("Dark", self._dark)
        for box in (self._labels, self._trails, self._truth):
            box.on_update(self._change)
        full.on_update(lambda _: self._scale(full.value))
        for control in (blind, least):
            control.on_update(lambda _: self._show_blind(least.value if blind.value else None))
        dark.on_update(lambda _: self._theme(dark.value))

    def _add_zeros(self) -> None:
        """Add the buttons for zeros."""
        gui = self.server.gui
        zero_all = gui.add_button("Zero all", hint="What all tactels read now becomes their zero")
        zero_all.on_click(lambda _: self._ask(lambda: self._follower.zero(None), "zero all"))
        names = [panels.board_name(self._arm, p) for p in range(self._arm.n_patches)]
        with gui.add_folder("Zero one board", expand_by_default=False):
            board = gui.add_dropdown("Board", names, initial_value=names[0])
            zero_one = gui.add_button("Zero this board")
        zero_one.on_click(
            lambda _: self._ask(lambda: self._follower.zero(names.index(board.value)), f"zero {board.value}")
        )

    def _add_recorder(self, recorder: BusRecorder) -> None:
        """Add the buttons of a recorder."""
        gui = self.server.gui
        self._record = gui.add_button_group("Recording", ("Start", "Mark", "Stop"))
        self._recorded = gui.add_html("")
        actions = {"Start": recorder.start, "Mark": recorder.mark, "Stop": recorder.stop}
        self._record.on_click(
            lambda _: self._ask(lambda: actions[self._record.value](), self._record.value.lower())
        )

    def _change(self, _: Any) -> None:
        self._is_changed = True

    def _scale(self, full_kpa: float) -> None:
        """Make another pressure the brightest."""
        self._drawer.full_pa = 1e3 * full_kpa
        self._legend.content = panels.legend(full_kpa)
        self._is_changed = True

    def _show_blind(self, least_n: float | None) -> None:
        """Show where a contact of a force is not felt; None hides it."""
        if least_n is None:
            self.stage.show_blind(np.zeros((0, 3)))
            return
        if self._coverage is None:
            self._coverage = coverage_of(self._arm)
        felt = self._coverage
        far = ~(felt.least_force <= least_n)
        points = np.zeros((int(far.sum()), 3))
        for k, link in enumerate(self._arm.links):
            here = felt.link[far] == k
            on, normals = link.surface.position(felt.s[far][here], felt.a[far][here])
            points[here] = placed(self._drawer.poses.X_BS[k], on + BLIND_LIFT * normals)
        self.stage.show_blind(points)

    def _theme(self, dark: bool) -> None:
        self._dark = dark
        self.server.gui.configure_theme(
            dark_mode=self._dark, show_logo=False, show_share_button=False, control_width="large"
        )

    def _plot(self, unit: str) -> Any:
        nothing = np.array([0.0, 1.0])
        return self.server.gui.add_uplot(
            (nothing, nothing * 0.0),
            _series([]),
            title=unit,
            aspect=1.5,
            scales={"x": viser.uplot.Scale(time=False)},
        )

    def _show_panels(self, cycle: Cycle | None) -> None:
        follower, history = self._follower, self._follower.history
        self._head.content = panels.head(
            self._title,
            *panels.state_of(cycle, self.drawing, follower.has_ended, follower.error),
            notes=(self._note, self._no_readings(cycle)),
            counts=(follower.n_cycles + history.n_lost, history.n_lost, self.n_drawn),
        )
        if self._playback is not None:
            self._playback.show()
        if self._recorder is not None:
            self._recorded.content = panels.recording(
                self._recorder.path,
                self._recorder.is_recording,
                self._recorder.n_frames,
                self._recorder.n_marks,
            )
        if cycle is None:
            return
        loads = self._pressed.of(cycle.readings)
        self._loads.content = panels.loads(self._arm, cycle, loads)
        self.stage.show_loads(self._drawer.load_labels(loads) if self._board_loads.value else ())
        self._boards.content = panels.boards(cycle, self._arm)
        self._cycle.content = panels.cycle_table(cycle, history, 1e3 / self._arm.bus.rate_hz)
        times, ids, forces = history.forces(len(SERIES))
        with self.server.atomic():  # a plot has as many columns as series
            if ids != self._ids:
                self._ids = ids
                self._forces.series = _series(ids)
            self._forces.data = (times, *(forces.T if ids else times[None] * 0.0))

    def _no_readings(self, cycle: Cycle | None) -> str:
        if cycle is None or self.drawing is None or self.drawing.has_readings or self.drawing.is_stale:
            return ""
        return "no readings from this source: tactels are grey"

    def _ask(self, do: Callable[[], object], what: str) -> None:
        """Do what a button asks for, and report the result on its page."""
        try:
            do()
        except SkinbusError as error:
            self._tell(f"{what}: {error}", "red")
        else:
            self._tell(f"{what}: done", "green")

    def _tell(self, text: str, colour: Any) -> None:
        for client in self.server.get_clients().values():
            client.add_notification("skinbus", text, color=colour, auto_close_seconds=4.0)


def _series(ids: list[int]) -> tuple[viser.uplot.Series, ...]:
    """Return the series of a plot of contacts; one without name where there are none."""
    names = [f"id {key}" for key in ids] or ["no contact"]
    return (
        viser.uplot.Series(label="s"),
        *(viser.uplot.Series(label=name, stroke=SERIES[k], width=2) for k, name in enumerate(names)),
    )
