"""Stop the robot when any force exceeds 15 N, or when the skin cannot be trusted any more."""

import skinbus

LIMIT_N = 15.0
STALE_S = 0.1


def stop_robot(why: str) -> None:
    print("stop:", why)  # in its place, the stop of your robot


with skinbus.open("forearm", channel="can0") as skin:
    for cycle in skin:
        for contact in cycle.contacts:
            if contact.force > LIMIT_N:
                stop_robot(f"{contact.force:.1f} N on {contact.link} at {1e3 * contact.s:.0f} mm")
        for patch in skin.patches:
            if patch.state.name == "SILENT" and patch.age_s > STALE_S:
                stop_robot(f"patch {patch.node_id} sends nothing")
