"""A sweep on a Dask cluster, in a process of its own: a cluster leaves threads and sockets behind.

Run by ``test_sweep``: `python -m tests.study.dask_sweep TABLE`.
"""

import sys
from pathlib import Path

from skinbus.study.cell import Cell
from skinbus.study.sweep import executor_of, run_sweep

CELLS = [
    Cell(family=family, method=method, trials=12) for family in ("one", "two") for method in ("kmeans", "fit")
]
PATIENCE = "300s"
"""For workers to start and connect: a busy machine may need longer than the usual half a minute."""


def main():
    """Run the cells on two workers into a table."""
    import dask  # not where CELLS are wanted only
    from distributed import LocalCluster

    dask.config.set(
        {"distributed.comm.timeouts.connect": PATIENCE, "distributed.comm.timeouts.tcp": PATIENCE}
    )
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True) as cluster,
        executor_of(cluster.scheduler_address) as executor,
    ):
        run_sweep(CELLS, Path(sys.argv[1]), executor)


if __name__ == "__main__":
    main()
