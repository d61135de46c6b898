"""A control loop at 1 kHz beside `skinbus run my-arm.toml --share arm`: how long does latest() take?"""

import time

import skinbus

SECONDS, PERIOD_NS = 10, 1_000_000
took_ns = []
with skinbus.attach("arm") as skin:
    due_ns = time.monotonic_ns()
    for _ in range(SECONDS * 1000):
        begin_ns = time.perf_counter_ns()
        cycle = skin.latest()
        took_ns.append(time.perf_counter_ns() - begin_ns)
        push_n = max((contact.force for contact in cycle.contacts), default=0.0)  # your controller's input
        due_ns += PERIOD_NS
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
p50, p99, worst = (sorted(took_ns)[int(q * (len(took_ns) - 1))] / 1e3 for q in (0.5, 0.99, 1.0))
print(f"latest(): p50 {p50:.1f} us, p99 {p99:.1f} us, max {worst:.1f} us; age now {1e3 * cycle.age_s:.0f} ms")
