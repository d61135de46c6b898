"""Log a minute of contacts to Parquet, and plot the force of each contact over time."""

import matplotlib.pyplot as plt
import pyarrow as pa
import pyarrow.parquet as pq

import skinbus

rows = []
with skinbus.open("forearm", channel="can0") as skin:
    for cycle in skin:
        for c in cycle.contacts:
            rows.append({"t_s": 1e-9 * cycle.t_ns, "id": c.id, "link": c.link, "s": c.s, "force_n": c.force})
        if cycle.number * skin.period_s >= 60:
            break
pq.write_table(pa.Table.from_pylist(rows), "contacts.parquet")
for id in {row["id"] for row in rows}:
    curve = [(row["t_s"], row["force_n"]) for row in rows if row["id"] == id]
    plt.plot(*zip(*curve, strict=True))
plt.savefig("forces.png")
