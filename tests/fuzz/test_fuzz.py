"""The fuzzers for a few seconds each; ``python -m tests.fuzz.files`` and the others run as long as you like."""

import os

import pytest
from fuzz import commands, files, inputs, machines, pool, tables

SHORT = {
    "files": (files, 70),
    "inputs": (inputs, 180),
    "commands": (commands, 24),
    "tables": (tables, 250),
    "machines": (machines, 60),
}


@pytest.mark.parametrize(("fuzzer", "count"), SHORT.values(), ids=SHORT)
def test_no_input_is_answered_with_a_traceback_or_nonsense(fuzzer, count):
    failures = list(pool.run(fuzzer.make(), range(count), processes=2))
    assert not failures, pool.report(failures)


def test_every_public_name_is_called():
    assert not inputs.uncovered()


def _attempt(seed, folder, note):
    note(f"seed {seed}")
    match seed:
        case 1:
            raise IndexError("from deep inside")
        case 2:
            while True:
                pass
        case 3:
            _ = bytearray(300 << 20)
        case 4:
            os._exit(9)
        case 5:
            return pool.Wrong("nonsense", "here", "of no meaning")
    return None


@pytest.mark.slow
def test_the_pool_reports_each_kind_of_failure_and_goes_on():
    most = pool.Most()
    found = {f.seed: f for f in pool.run(_attempt, range(8), processes=2, seconds=2.0, memory=200 << 20, most=most)}
    kinds = {seed: failure.wrong.kind for seed, failure in found.items()}
    assert kinds == {1: "traceback", 2: "hang", 3: "memory", 4: "died", 5: "nonsense"}
    assert found[2].what == "seed 2"
    assert most.slowest == "seed 2: seed 2" and most.seconds > 0.4
    assert most.largest == "seed 3: seed 3" and most.memory > 250 << 20


@pytest.mark.slow
def test_a_seed_is_the_same_input_again():
    first = [(f.seed, f.what, f.wrong) for f in pool.run(_attempt, range(6), seconds=0.5, memory=200 << 20)]
    again = [(f.seed, f.what, f.wrong) for f in pool.run(_attempt, range(5, 6))]
    assert again == first[-1:]
