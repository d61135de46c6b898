"""What became of the frames and lines of a recording, for `skinbus replay` and `skinbus export`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from skinbus.cli.formatting import counted
from skinbus.cli.output import echo
from skinbus.master.replay import Replay
from skinbus.skin.replayed import Recording


def frames_of(replay: Replay, recording: Recording) -> dict[str, Any]:
    """Return the numbers, for a program."""
    counters, taken, reader = replay.master.gather.counters, replay.taken, recording.reader
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
        "elsewhere": dict(sorted(recording.elsewhere.items())),
        "strange_lines": reader.n_strange,
        "cut_line": reader.is_cut,
        "dropped_by_recorder": reader.n_dropped,
        "clock_jumps": replay.timeline.n_jumps,
    }


def in_words(replay: Replay, recording: Recording) -> Iterator[str]:
    """Return the same as lines of text; what did not occur is left out."""
    frames, first = frames_of(replay, recording), recording.reader.first_strange
    readings = frames["readings"]
    yield (
        f"readings: {counted(readings['used'], 'frame')} used, {readings['late']} late, "
        f"{readings['missing']} missing, {readings['bad_length']} of wrong length; "
        f"{counted(frames['others'], 'other frame')}"
    )
    left_out = [counted(frames[kind], f"{kind} frame") for kind in ("error", "remote") if frames[kind]]
    left_out += [f"{counted(n, 'frame')} of {name}" for name, n in frames["elsewhere"].items()]
    if first:
        n = frames["strange_lines"]
        what = "1 line that is no frame, at" if n == 1 else f"{n} lines that are no frames, the first at"
        left_out.append(f"{what} {first.key}")
    if frames["cut_line"]:
        left_out.append("the last line, which is not whole")
    if left_out:
        yield f"left out: {'; '.join(left_out)}"
    if frames["dropped_by_recorder"]:
        yield f"the recorder had no room for {counted(frames['dropped_by_recorder'], 'frame')}"
    if frames["clock_jumps"]:
        yield f"the clock of the log jumped {counted(frames['clock_jumps'], 'time')}"


def has_readings(replay: Replay, recording: Recording) -> bool:
    """Return whether a patch of the arm sent readings, and say so if none did."""
    if replay.master.table.last_fresh.any():
        return True
    others = ", ".join(sorted(recording.elsewhere))
    also = f" It also holds {others}: see --channel." if others else ""
    echo(f"no patch of {recording.arm.name} sent readings: is it the log of another arm?{also}", err=True)
    return False
