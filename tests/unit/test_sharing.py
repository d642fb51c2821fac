"""Problems and branches that are pickled, copied, and shared by threads."""

import copy
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Barrier

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

import hbgear as hb
from hbgear.common.lru_cache import LRUCache


@dataclass(frozen=True)
class Soft(hb.mechanics.Law):
    """p = tanh d + v / 10: sampled, and depends on the velocity."""

    @property
    def reference(self):
        return 1.0

    def force(self, d, v, tau):
        return np.tanh(d) + 0.1 * v, 1 / np.cosh(d) ** 2, np.full_like(d, 0.1)


@dataclass(frozen=True)
class Pair(hb.mechanics.Model):
    """Two masses, one on a backlash, one on a law that is sampled."""

    zeta: float = 0.05
    b: float = 1.0

    def system(self):
        M, K = np.eye(2), np.array([[0.3, -0.1], [-0.1, 0.4]])
        elements = [
            hb.Element([1.0, 0.0], hb.Backlash(self.b), name="gap"),
            hb.Element([0.0, 1.0], hb.mechanics.Parallel((Soft(), hb.Backlash(2.0, 0.5))), name="soft"),
        ]
        return hb.System(M, 2 * self.zeta * M, K, elements, hb.Load([0.1, 0.0], cosine={1: [0.5, 0.1]}))


def sampled():
    """A branch of sampled laws, short."""
    return hb.trace(hb.HarmonicBalance(Pair(), 4), "Omega", (0.9, 1.0))


@pytest.mark.parametrize(
    "again", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy, copy.copy], ids=["pickle", "deepcopy", "copy"]
)
def test_branches_of_sampled_laws_are_copied_with_their_problem(again):
    branch = sampled()
    twin = again(branch)
    assert np.array_equal(twin.X, branch.X) and twin.status is branch.status and repr(twin) == repr(branch)
    assert np.array_equal(twin.amplitude("rms", dof=1), branch.amplitude("rms", dof=1))
    here = branch.parameters_at(0)
    values = [b.problem.evaluate(branch.X[0], **here) for b in (branch, twin)]
    assert all(np.array_equal(one, other) for one, other in zip(*values, strict=True))
    onward = [hb.trace(b.problem, "Omega", (1.0, 1.1), start=b[-1]) for b in (branch, twin)]
    assert np.array_equal(onward[0].X, onward[1].X)


def test_other_results_are_pickled_too():
    fold = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 4), "Omega", (0.9, 0.6))["LP1"]
    curve = hb.trace(
        hb.continuation.FoldProblem(hb.HarmonicBalance(hb.SpurPair(), 4), "Omega"), "zeta", (0.05, 0.055), start=fold
    )
    again = pickle.loads(pickle.dumps(curve))
    assert np.array_equal(again.X, curve.X) and again.problem.problem.model == hb.SpurPair()


# ---- threads


def rows(problem, task):
    parameter, span, at = task
    branch = hb.trace(problem, parameter, span, at=at)
    return branch.values, branch.X, branch.multipliers


TASKS = [
    ("Omega", (0.95, 0.7), {}),
    ("Omega", (0.7, 0.95), {"zeta": 0.06}),
    ("Omega", (0.6, 0.8), {"b": 0.9}),
    ("zeta", (0.05, 0.08), {"Omega": 0.75}),
    ("b", (1.0, 0.7), {"Omega": 0.9}),
    ("Omega", (0.95, 0.7), {"zeta": 0.07}),
]


@pytest.fixture
def hasty():
    """Threads take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.slow
@pytest.mark.parametrize("model", [hb.SpurPair(eps=(0.2,)), Pair()], ids=["exact", "sampled"])
def test_threads_that_share_a_problem_find_the_same_results(model, hasty):
    together = Barrier(len(TASKS))
    shared = hb.HarmonicBalance(model, 6)

    def at_once(task):
        together.wait(timeout=60)
        return rows(shared, task)

    with threadpool_limits(1):
        alone = [rows(hb.HarmonicBalance(model, 6), task) for task in TASKS]
        with ThreadPoolExecutor(len(TASKS)) as pool:
            found = list(pool.map(at_once, TASKS))
    for one, other, task in zip(alone, found, TASKS, strict=True):
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True)), task


def test_earlier_calls_change_nothing():
    used, task = hb.HarmonicBalance(hb.SpurPair(eps=(0.2,)), 6), TASKS[0]
    alone = rows(hb.HarmonicBalance(hb.SpurPair(eps=(0.2,)), 6), task)
    for other in TASKS:
        rows(used, other)
    assert all(np.array_equal(a, b) for a, b in zip(rows(used, task), alone, strict=True))


def test_the_last_are_kept_and_copies_start_empty():
    made = []
    recent = LRUCache(2)
    for key in (1, 2, 1, 3, 1, 2):
        assert recent.get(key, lambda key=key: made.append(key) or -key) == -key
    assert made == [1, 2, 3, 2]
    assert copy.copy(recent).get(1, lambda: "new") == "new" and recent.get(1, lambda: "new") == -1
