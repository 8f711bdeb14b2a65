"""What a crowd is taken to know exceeds what any cameras in view tell together."""

import numpy as np

from placement.fewest.crowds import join_of_all, worst_dark


def test_the_join_lies_above_every_camera_at_every_sample() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        t, cameras = 12, 9
        first = np.sort(rng.integers(0, t, cameras))
        length = np.minimum(rng.integers(1, 6, cameras), t - first)
        ptr = np.concatenate([[0], np.cumsum(length)]).astype(np.int64)
        root = rng.normal(size=(int(ptr[-1]), 2, 2))
        full = root @ root.transpose(0, 2, 1)
        blocks = np.stack([full[:, 0, 0], full[:, 0, 1], full[:, 1, 1]], axis=1)
        at = np.searchsorted(first, np.arange(t + 1)).astype(np.int64)
        best = np.empty((t, 3))
        join_of_all(at, ptr, blocks, best)
        seen = np.zeros(t, dtype=bool)
        for v in range(cameras):
            for e in range(ptr[v], ptr[v + 1]):
                s = first[v] + e - ptr[v]
                seen[s] = True
                d = best[s] - blocks[e]
                assert np.linalg.eigvalsh([[d[0], d[1]], [d[1], d[2]]]).min() >= -1e-12
        assert not best[~seen].any()


def test_of_a_sets_failures_the_one_that_looks_worst_is_kept() -> None:
    p = np.zeros((5, 6))
    p[2:, 3] = [0.1, 0.3, 0.2]
    assert [worst_dark(p, n) for n in (1, 2, 3)] == [2, 3, 3]
    p[2:, 5] = [0.0, 0.0, 1.0]  # a heading that is forgotten counts some way ahead
    assert worst_dark(p, 3) == 4
