"""Stop the robot when a force exceeds 15 N, when readings of any patch are missing or old, and at the end."""

import time

import skinbus

LIMIT_N, STALE_PERIODS = 15.0, 3
stop_robot = print  # in its place, the stop of your robot
try:
    with skinbus.open("forearm", channel="can0") as skin:
        while skin.is_running:
            for c in (cycle := skin.latest()).contacts:  # never waits; when no cycles come, ages grow
                if c.force > LIMIT_N:
                    stop_robot(f"stop: {c.force:.1f} N on {c.link} at {1e3 * c.s:.0f} mm")
            for p in cycle.patches:
                if p.state.name != "OPERATIONAL" or p.age_s > STALE_PERIODS * skin.period_s:
                    stop_robot(f"stop: patch {p.node_id} {p.state.name}, {1e3 * p.age_s:.0f} ms old")
            time.sleep(skin.period_s / 4)
finally:  # an error too
    stop_robot("stop: the skin has ended")
