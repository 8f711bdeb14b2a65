"""Four kinds of work on a Dask cluster of two processes, one of which is killed on the way."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from placement.assemble import Scene, assemble
from placement.city.information import Site
from placement.city.partitions import partitioned_greedy
from placement.city.solve import (
    CityProblem,
    alone_gains,
    compute_city,
    greedy,
    load_city,
    open_store,
    prove,
)
from placement.cluster import DaskCluster, Serial, Work
from placement.instance import instance_from_dict
from placement.validation import validate
from tests.placement.city.test_city import small_site

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore:.*:pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::UserWarning:distributed"),
]


class Slow:
    """Run tasks on a cluster so slowly that there is time to kill a worker in the middle."""

    def __init__(self, place: Work, kill: bool) -> None:
        self.place = place
        self.kill = kill

    def run(self, function: Any, tasks: Any, name: str) -> Iterator[tuple[int, Any]]:
        if not self.kill:
            yield from self.place.run(function, tasks, name)
            return
        slow = [(function, tasks[i]) for i in range(len(tasks))]
        client = self.place._client  # type: ignore[attr-defined]
        pids = list(client.run(os.getpid).values())

        def strike() -> None:
            time.sleep(0.3)
            os.kill(pids[0], signal.SIGKILL)

        striker = threading.Thread(target=strike)
        striker.start()
        yield from self.place.run(slowly, slow, name)
        striker.join()

    def close(self) -> None:
        self.place.close()


def slowly(task: tuple[Any, Any]) -> Any:
    time.sleep(0.4)
    return task[0](task[1])


def die(_task: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture(scope="module")
def cluster() -> Iterator[DaskCluster]:
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as local:
        place = DaskCluster(local.scheduler_address)
        yield place
        place.close()


@pytest.fixture(scope="module")
def site() -> Site:
    return small_site()


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("placement.city.information.CHUNK_MOUNTS", 24)
    monkeypatch.setattr("placement.city.regions.REGION_ENTRIES", 300)


@pytest.fixture
def problem(site: Site, tmp_path: Path) -> CityProblem:
    store = open_store(tmp_path / "here", site, {})
    compute_city(site, store)
    return load_city(site, store, 0.5)


@pytest.mark.parametrize("kill", [False, True])
def test_information_is_the_same_to_the_byte(
    cluster: DaskCluster, site: Site, problem: CityProblem, tmp_path: Path, kill: bool
) -> None:
    store = open_store(tmp_path / "there", site, {})
    assert compute_city(site, store, Slow(cluster, kill)) == site.n_chunks >= 3
    for number in range(site.n_chunks):
        name = f"chunk-{number:05d}.npz"
        assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


@pytest.mark.parametrize("kill", [False, True])
def test_greedy_by_partitions_is_the_same(
    cluster: DaskCluster, problem: CityProblem, kill: bool
) -> None:
    here = partitioned_greedy(problem, 6, Serial(), parts=4)
    there = partitioned_greedy(problem, 6, Slow(cluster, kill), parts=4)
    assert here[0].tobytes() == there[0].tobytes()
    assert here[1].tobytes() == there[1].tobytes()


@pytest.mark.parametrize("kill", [False, True])
def test_the_certificate_is_the_same(
    cluster: DaskCluster, problem: CityProblem, kill: bool
) -> None:
    alone = alone_gains(problem)
    chosen, gains = greedy(problem, 6, alone)
    last = float(gains[-1])
    here = prove(problem, 6, alone, chosen, last, Serial(), 30)
    assert prove(problem, 6, alone, chosen, last, Slow(cluster, kill), 30) == here


@pytest.mark.parametrize("kill", [False, True])
def test_drives_are_the_same(cluster: DaskCluster, kill: bool) -> None:
    scene: Scene = assemble(
        instance_from_dict(
            {
                "road": {"pieces": [{"length": 60.0}]},
                "mounts": {"spacing_m": 20.0},
                "objective": {"kind": "localisation"},
            }
        )
    )
    here = validate(scene, [0, 40], runs=200, seed=3)
    there = validate(scene, [0, 40], runs=200, seed=3, work=Slow(cluster, kill))
    assert here.rows.equals(there.rows)
    assert here.summary == there.summary
    np.testing.assert_array_equal(
        here.profile.position_rms_m["ekf"], there.profile.position_rms_m["ekf"]
    )


def test_a_task_that_kills_workers_is_named(cluster: DaskCluster) -> None:
    with pytest.raises(ValueError, match="deadly: task 0 killed"):
        list(cluster.run(die, [0], "deadly"))
