"""Report of `skinbus replay`: contacts from touch to lift, a file of every cycle, and what was left out."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skinbus.can.candump import CandumpReader
from skinbus.cli.formatting import counted, nodes, words_of
from skinbus.cli.live import rows_of
from skinbus.master import CycleReport
from skinbus.master.replay import Replay
from skinbus.model import Arm
from skinbus.view.compare import Differences

COLUMNS = ["time", "t_s", "sync", "id", "link", "state", "s_mm", "a_mm", "force_n", "level", "quality"]
"""Of the CSV file: ``time`` of the SYNC as the recording has it, ``t_s`` since its first frame."""


@dataclass(slots=True)
class Life:
    """A contact from its first cycle to its last; its place is where it was firmest."""

    id: int
    link: str
    from_s: float
    to_s: float
    s_mm: float
    a_mm: float
    force_n: float
    """At its most."""
    cycles: int = 0


class Account:
    """Keeps the contacts of all cycles in a time, as lives and in a file."""

    def __init__(self, arm: Arm, start_s: float | None, end_s: float | None, out: Path | None) -> None:
        self.n_cycles = 0
        self.t_ns = 0
        """Of the newest cycle, since the first frame."""
        self.happened_ns = 0
        self.replay: Replay | None = None
        """Whose cycles these are."""
        self._links = tuple(link.name for link in arm.links)
        self._start_ns = round((start_s or 0.0) * 1e9)
        self._end_ns = None if end_s is None else round(end_s * 1e9)
        self._lives: dict[int, Life] = {}
        self._file = out.open("w", encoding="utf-8", newline="") if out else None
        self._rows = csv.writer(self._file, lineterminator="\n") if self._file else None
        if self._rows:
            self._rows.writerow(COLUMNS)

    @property
    def lives(self) -> list[Life]:
        """All contacts, in the order in which they came."""
        return list(self._lives.values())

    def now_s(self) -> float:
        """Return when the last thing happened, s since the first frame."""
        return self.happened_ns * 1e-9

    def counts(self, t_ns: int) -> bool:
        """Whether a cycle of this time is shown."""
        return t_ns >= self._start_ns and (self._end_ns is None or t_ns <= self._end_ns)

    def take(self, report: CycleReport) -> None:
        """Take a cycle."""
        self.t_ns = report.t_ns
        self.happened_ns = report.t_ns + report.latency_ns
        if not self.counts(report.t_ns):
            return
        self.n_cycles += 1
        t_s = report.t_ns * 1e-9
        tracks = report.tracks
        for n in np.flatnonzero((tracks.slot >= 0) & (tracks.row >= 0)).tolist():
            s_mm, a_mm, force = 1e3 * float(tracks.s[n]), 1e3 * float(tracks.a[n]), float(tracks.force[n])
            identity = int(tracks.identity[n])
            life = self._lives.get(identity)
            if life is None:
                link = self._links[int(tracks.link[n])]
                life = Life(int(tracks.id[n]), link, t_s, t_s, s_mm, a_mm, force)
                self._lives[identity] = life
            elif force > life.force_n:
                life.link = self._links[int(tracks.link[n])]
                life.s_mm, life.a_mm, life.force_n = s_mm, a_mm, force
            life.to_s = t_s
            life.cycles += 1
        if self._rows:
            self._rows.writerows(self._lines(report))

    def close(self) -> None:
        """Finish the file."""
        if self._file:
            self._file.close()

    def _lines(self, report: CycleReport) -> Iterator[list[Any]]:
        """Return the rows of a cycle, contacts as they are published."""
        stamp_us = self.replay.sync_stamp_ns // 1000 if self.replay else 0
        contacts = report.contacts
        seen = {identity: i for i, identity in enumerate(report.ids.tolist())}
        for row in rows_of(report):
            i = seen.get(row.id)
            doubts = ("", "") if i is None else (contacts.level[i], words_of(int(contacts.quality[i])))
            yield [
                f"{stamp_us // 1_000_000}.{stamp_us % 1_000_000:06d}",
                f"{report.t_ns * 1e-9:.6f}",
                report.counter,
                row.id,
                self._links[row.link],
                row.state.name.lower(),
                f"{1e3 * row.s:.2f}",
                f"{1e3 * row.a:.2f}",
                f"{row.force:.3f}",
                *doubts,
            ]


def table(lives: Sequence[Life]) -> Iterator[str]:
    """Return a line for each contact, below a line of heads."""
    width = max([4, *(len(life.link) for life in lives)])
    yield f"contact  {'link':<{width}}    from s      to s    s mm    a mm  force N  cycles"
    for life in lives:
        yield (
            f"{life.id:>7}  {life.link:<{width}} {life.from_s:>9.3f} {life.to_s:>9.3f} {life.s_mm:>7.1f} "
            f"{life.a_mm:>7.1f} {life.force_n:>8.2f} {life.cycles:>7}"
        )


def silent_nodes(replay: Replay) -> Iterator[str]:
    """Return by bus the patches that never sent all of their readings."""
    master = replay.master
    for bus, settings in enumerate(master.arm.buses):
        patches = master.arm.patches_on(bus)
        node_ids = master.arm.node_id[patches][master.table.last_fresh[patches] == 0].tolist()
        if node_ids:
            where = f"{settings.name} " if master.n_buses > 1 else ""
            yield f"{where}{nodes(node_ids)}"


def frames_of(replay: Replay, reader: CandumpReader, elsewhere: Mapping[str, int]) -> dict[str, Any]:
    """Return what became of the frames and lines of the recording, for a program."""
    counters, taken = replay.master.gather.counters, replay.taken
    return {
        "readings": {
            "used": counters.accepted,
            "late": counters.late,
            "bad_length": counters.bad_length,
            "missing": counters.missing,
        },
        "others": taken.n_others,
        "remote": taken.n_remote,
        "error": taken.n_error,
        "elsewhere": dict(sorted(elsewhere.items())),
        "strange_lines": reader.n_strange,
        "cut_line": reader.is_cut,
        "dropped_by_recorder": reader.n_dropped,
        "clock_jumps": replay.timeline.n_jumps,
    }


def in_words(frames: Mapping[str, Any], reader: CandumpReader) -> Iterator[str]:
    """Return the same as text; what did not occur is left out."""
    readings = frames["readings"]
    yield (
        f"readings: {counted(readings['used'], 'frame')} used, {readings['late']} late, "
        f"{readings['missing']} missing, {readings['bad_length']} of wrong length; "
        f"{counted(frames['others'], 'other frame')}"
    )
    left_out = [
        counted(n, thing)
        for n, thing in ((frames["error"], "error frame"), (frames["remote"], "remote frame"))
        if n
    ]
    left_out += [f"{counted(n, 'frame')} of {name}" for name, n in frames["elsewhere"].items()]
    if reader.first_strange:
        n, where = frames["strange_lines"], reader.first_strange.key
        left_out.append(
            f"1 line that is no frame, at {where}"
            if n == 1
            else f"{n} lines that are no frames, the first at {where}"
        )
    if frames["cut_line"]:
        left_out.append("the last line, which is not whole")
    if left_out:
        yield f"left out: {'; '.join(left_out)}"
    if frames["dropped_by_recorder"]:
        yield f"the recorder had no room for {counted(frames['dropped_by_recorder'], 'frame')}"
    if frames["clock_jumps"]:
        yield f"the clock of the log jumped {counted(frames['clock_jumps'], 'time')}"


def comparison_of(found: Differences) -> dict[str, Any]:
    """Return what a comparison found, for a program."""
    values = asdict(found)
    first_ns, largest_m = values.pop("first_ns"), values.pop("largest_m")
    return {key.removeprefix("n_"): value for key, value in values.items() if key != "largest_n"} | {
        "first_s": None if first_ns is None else round(first_ns * 1e-9, 6),
        "largest_mm": round(1e3 * largest_m, 2),
        "largest_force_n": round(found.largest_n, 3),
    }


def compared(found: Differences) -> Iterator[str]:
    """Return the same as text."""
    n = found.n_same + found.n_different
    ids = f" ({found.n_renumbered} with other ids)" if found.n_renumbered else ""
    yield f"compared: {found.n_same} of {counted(n, 'cycle')} have the same contacts{ids}"
    if found.n_different:
        first_s = 1e-9 * (found.first_ns or 0)
        yield (
            f"different: {counted(found.n_different, 'cycle')}, the first at {first_s:.3f} s; "
            f"at most {1e3 * found.largest_m:.1f} mm and {found.largest_n:.2f} N; "
            f"{counted(found.n_states, 'contact')} in another state, {found.n_missing} only in the log, "
            f"{found.n_new} only now"
        )
        if found.n_flagged:
            yield f"in {found.n_flagged} of them the master had not the time for its level"
    if found.n_recorded_only or found.n_made_only:
        yield (
            f"not compared: {counted(found.n_recorded_only, 'cycle')} only in the log, "
            f"{found.n_made_only} only now"
        )
