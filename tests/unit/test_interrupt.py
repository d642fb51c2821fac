"""Ctrl-C, SIGTERM and errors at any moment: completed results are kept, and the message reports it."""

import dataclasses
import inspect
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import hbgear as hb
from hbgear import Status
from hbgear.analysis import jump_maps
from hbgear.cli.app import main
from hbgear.common.atomic_write import atomic_write
from hbgear.common.process.signals import defer_signals, sigterm_like_ctrl_c
from hbgear.continuation.tracing.special_points import SpecialPoints
from hbgear.harmonic.models.model_registry import rebuild_model
from hbgear.io.map_file import read_map, save_map
from hbgear.time.exponential.integrator import ExponentialIntegrator
from hbgear.time.steady_state import SteadyStateSettings

pytestmark = pytest.mark.slow

ROOT = str(Path(hb.__file__).parent)
DUFFING = hb.Duffing()


class Bug(Exception):
    """An error that hbgear does not handle by its type."""


def at_call(n, work, error=KeyboardInterrupt):
    """Return the result of work() and the number of hbgear calls, of which the n-th raises; none does if n = 0."""
    count = 0

    def profile(frame, event, arg):
        nonlocal count
        code = frame.f_code  # Python ignores errors raised in a generator while it is closed
        if event == "call" and code.co_filename.startswith(ROOT) and not code.co_flags & inspect.CO_GENERATOR:
            count += 1
            if count == n:
                raise error

    sys.setprofile(profile)
    try:
        return work(), count
    finally:
        sys.setprofile(None)


def moments(count, many):
    """Return call numbers spread evenly over all calls, including the first and the last three."""
    return sorted({int(n) for n in np.linspace(1, count, many)} | {count - i for i in range(3)})


def parts(work, count, many=7):
    """Yield the results of work() interrupted at calls spread evenly over all; None if there is no result yet."""
    for n in moments(count, many):
        try:
            part, reached = at_call(n, work)
        except KeyboardInterrupt:
            yield None
            continue
        if reached >= n:
            yield part


def within(part, whole):
    """Return whether all points of a branch are points of another one."""
    rows = {(float(value), X.tobytes()) for value, X in zip(whole.values, whole.X, strict=True)}
    return all((float(value), X.tobytes()) in rows for value, X in zip(part.values, part.X, strict=True))


class GeneralLoop(hb.HarmonicBalance):
    """Traced without the compiled loop."""

    def compiled_continuation(self, name, parameters):
        return None


def curve():
    return hb.trace(GeneralLoop(DUFFING, 3), "Omega", (0.9, 1.3), steps=hb.StepControl(max_step=0.1))


def strides():
    return hb.trace(
        hb.HarmonicBalance(DUFFING, 3), "Omega", (0.9, 1.3), steps=hb.StepControl(first_step=0.004, max_step=0.004)
    )


def adaptive():
    return hb.trace(hb.HarmonicBalance(DUFFING, "auto", tolerance=1e-4), "Omega", (1.3, 0.9))


def folds():
    point = known_fold()
    return hb.trace(
        hb.continuation.FoldProblem(hb.HarmonicBalance(DUFFING, 3)), "zeta", (point.parameters["zeta"], 0.06), point
    )


@cache
def known_fold():
    return hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", (0.6, 1.6), stability=False)["LP1"]


@pytest.mark.parametrize("work", [curve, strides, adaptive, folds])
@pytest.mark.parametrize("error", [KeyboardInterrupt, Bug])
def test_a_trace_survives_any_exception_at_any_call(work, error, tmp_path):
    work()  # fills the caches
    whole, count = at_call(0, work)
    kept = []
    for n in moments(count, 14):
        try:
            part, reached = at_call(n, work, error)
        except error:  # before the first point, or while the result is assembled
            assert not kept or (error is Bug and n > count - 20)
            continue
        assert within(part, whole), n
        part.save(tmp_path / "b.npz")
        assert len(hb.load(tmp_path / "b.npz")) == len(part)
        if reached < n or (error is Bug and part.status.complete):  # only the batch failed
            assert len(part) == len(whole) and np.array_equal(part.multipliers, whole.multipliers)
            continue
        assert part.status is (Status.INTERRUPTED if error is KeyboardInterrupt else Status.FAILED), n
        assert part.status.advice[1:] in part.message, n
        if work is not folds and error is KeyboardInterrupt:  # special points are monitored last
            unseen = np.flatnonzero(~np.isfinite(part.multipliers).all(axis=1))
            assert set(part.values[unseen]) <= {point.parameters["Omega"] for point in part.special}, n
        kept.append(len(part))
    # most late errors occur in batches of points, which are then computed one by one
    assert max(kept) > (0.6 if error is Bug else 0.9) * len(whole) and len(set(kept)) > 4


class Signalled(hb.HarmonicBalance):
    """Sends Ctrl-C during the third run of the compiled loop."""

    calls = 0
    heard = False

    def compiled_continuation(self, name, parameters):
        loop = super().compiled_continuation(name, parameters)

        def signalled(*arguments):
            self.calls += 1
            if self.calls != 3:
                return loop(*arguments)
            threading.Timer(0.01, signal.raise_signal, [signal.SIGINT]).start()
            try:
                loop(*arguments)
                while True:  # the signal is late
                    time.sleep(0.01)
            except KeyboardInterrupt:
                self.heard = True
                raise

        return signalled


def test_ctrl_c_while_the_compiled_loop_runs():
    """The trace stops when the call returns and keeps the points of earlier calls with their stability."""
    problem = Signalled(hb.SpurPair(), 60)
    few = hb.StepControl(first_step=1e-4, max_step=1e-4)
    part = hb.trace(problem, "Omega", (0.9, 0.8), steps=few)
    assert problem.heard and problem.calls == 3
    assert part.status is Status.INTERRUPTED and "interrupted at Omega" in part.message
    whole = hb.trace(
        hb.HarmonicBalance(hb.SpurPair(), 60),
        "Omega",
        (0.9, 0.8),
        special=False,
        stability=False,
        steps=hb.StepControl(first_step=1e-4, max_step=1e-4, max_points=len(part)),
    )
    assert len(part) > 64 and np.array_equal(part.values, whole.values) and np.array_equal(part.X, whole.X)
    assert np.isfinite(part.multipliers).all()


class Counted(hb.HarmonicBalance):
    """Records the number of motions monitored in each call."""

    def observe_many(self, X, *arguments, **parameters):
        self.calls = [*getattr(self, "calls", []), len(X)]
        return super().observe_many(X, *arguments, **parameters)


def test_ctrl_c_waits_for_few_motions_of_a_large_structure():
    """All modes of 150 coordinates take about 20 ms per motion: the batch size keeps a call below half a second."""

    def chain(n):
        K, end = 20 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)), np.eye(n)[-1]
        load = hb.Load(cosine={1: 5 * end})
        return hb.System(np.eye(n), 0.02 * (K + np.eye(n)), K, [hb.Element(end, hb.Backlash(b=0.1, k=5.0))], load)

    whole = Counted(chain(150), 5, reduce=False)
    assert whole.batch_size == 7 and Counted(chain(150), 5).batch_size == 128
    assert Counted(hb.Duffing(), 5, reduce=False).batch_size == 128
    part = hb.trace(whole, "Omega", (1.0, 1.2), steps=hb.StepControl(max_points=30))
    assert len(part) >= 20 and max(whole.calls) <= 2 * whole.batch_size + 1 and len(whole.calls) > 2


def test_a_jump_map_keeps_fold_curves_that_are_whole():
    def work():
        return hb.jump_map(DUFFING, "zeta", (0.03, 0.05), frequencies=(0.6, 1.6), harmonics=3, seeds=2)

    work()
    whole, count = at_call(0, work)
    assert whole.status.complete and len(whole.arms) == 2
    seen = set()
    for part in parts(work, count):
        if part is None:
            seen.add(0)
            continue
        assert part.status is Status.INTERRUPTED and "interrupted" in part.message
        assert len(part.folds) == len(part.arms) and all(fold.status.complete for fold in part.folds)
        for arm, other in zip(part.arms, whole.arms, strict=False):
            np.testing.assert_array_equal(arm.values, other.values)
            np.testing.assert_array_equal(arm.Omega, other.Omega)
            assert arm.direction == other.direction
        seen.add(len(part.arms))
    assert seen == {0, 1, 2}


def test_an_interrupted_jump_map_goes_on_from_its_file(tmp_path):
    """After any interruption the arms equal the arms of the whole map, and no curve is traced twice."""
    problem = hb.HarmonicBalance(DUFFING, 3)
    span, frequencies = (0.03, 0.05), (0.6, 1.6)

    def work(known=None):
        return hb.jump_map(problem, "zeta", span, frequencies=frequencies, seeds=3, known=known)

    work()
    whole, count = at_call(0, work)
    stopped = [part for part in parts(work, count) if part is not None and part.status is Status.INTERRUPTED]
    assert {(bool(part.curves), bool(part.folds)) for part in stopped} == {(True, False), (True, True)}
    assert all(part.message.endswith("(in Python: jump_map(..., known=this map))") for part in stopped)
    for part in stopped[:: max(1, len(stopped) // 6)]:
        save_map(part, tmp_path / "a.part.npz")
        known = read_map(tmp_path / "a.part.npz", problem, "zeta", span, frequencies)
        assert (len(known.curves), len(known.folds)) == (len(part.curves), len(part.folds))
        done = work(known)
        assert done.status.complete and len(done.arms) == len(whole.arms)
        assert all(one is other for one, other in zip(done.folds, known.folds, strict=False))
        for arm, other in zip(done.arms, whole.arms, strict=True):
            np.testing.assert_allclose(arm.Omega[[0, -1]], other.Omega[[0, -1]], rtol=1e-9)
            assert arm.direction == other.direction


def test_an_interrupted_map_advises_in_terms_of_the_command(run, monkeypatch):
    problem = hb.HarmonicBalance(DUFFING, 3)
    done = hb.jump_map(problem, "zeta", (0.03, 0.05), frequencies=(0.6, 1.6), seeds=2)
    part = dataclasses.replace(done, status=Status.INTERRUPTED, message="interrupted. Complete curves are kept")
    monkeypatch.setattr(hb, "jump_map", lambda *_, **__: part)
    line = ("map", "duffing", "--in", "zeta=0.03:0.05", "--harmonics", "3", "--from", "0.6", "--to", "1.6")
    for more, said in (((), "complete; with -o FILE.csv they are kept:"), (("-o", "a.csv"), "kept in 'a.part.npz':")):
        code, out, err = run(*line, *more)
        assert code == 3 and f"are {said} the same command continues from there" in " ".join(out.split())
        assert "hb." not in out + err


def test_a_part_of_a_map_keeps_all_curves_of_the_range(tmp_path):
    problem, path = hb.HarmonicBalance(hb.SpurPair(zeta=0.01, eps=(0.0, 0.2), e=(0.05,)), 8), tmp_path / "a.part.npz"
    found = hb.jump_map(problem, "zeta", (0.01, 0.011), frequencies=(1.5, 0.3), seeds=2)
    save_map(found, path)
    known = read_map(path, problem, "zeta", (0.01, 0.011), (1.5, 0.3))
    for one, other in zip(found.curves, known.curves, strict=True):
        assert len(one.others) == len(other.others) == 1 and one.asymptotes == other.asymptotes
        np.testing.assert_array_equal(one.others[0].X, other.others[0].X)
    assert len(known.folds) == len(found.folds) == 2


def test_the_part_of_another_jump_map_is_refused(tmp_path):
    problem, path = hb.HarmonicBalance(DUFFING, 3), tmp_path / "a.part.npz"
    found = hb.jump_map(problem, "zeta", (0.03, 0.05), frequencies=(0.6, 1.6), seeds=2)
    save_map(found, path)
    for args, said in (
        ((problem, "zeta", (0.03, 0.06), (0.6, 1.6)), "another map"),
        ((problem, "zeta", (0.03, 0.05), (0.6, 1.7)), "another map"),
        ((hb.HarmonicBalance(DUFFING, 4), "zeta", (0.03, 0.05), (0.6, 1.6)), "other harmonics"),
        ((hb.HarmonicBalance(DUFFING.replace(F=0.3), 3), "zeta", (0.03, 0.05), (0.6, 1.6)), "another model"),
    ):
        with pytest.raises(ValueError, match=f"of a jump map of {said}.*remove this one"):
            read_map(path, *args)
    with pytest.raises(ValueError, match="nothing to save"):
        save_map(dataclasses.replace(found, curves=()), path)


def test_the_map_command_goes_on_where_it_was_interrupted(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["map", "duffing", "--in", "zeta=0.03:0.05", "--harmonics", "3", "--seeds", "2", "-o", "out.csv"]
    usual, traced = jump_maps._fold_curve, []

    def counted(*given):
        traced.append(1)
        if len(traced) == 2:
            raise KeyboardInterrupt
        return usual(*given)

    monkeypatch.setattr(jump_maps, "_fold_curve", counted)
    assert exit_of(words) == 3
    assert "1 response curves and 1 fold curves are kept in 'out.part.npz'" in capsys.readouterr().out
    assert sorted(os.listdir()) == ["out.csv", "out.part.npz"]
    assert exit_of(words) == 0
    assert "continuing from 'out.part.npz'" in capsys.readouterr().out and os.listdir() == ["out.csv"]
    again = Path("out.csv").read_text()
    assert exit_of(words) == 0 and len(Path("out.csv").read_text().splitlines()) == len(again.splitlines())
    assert len(traced) == 2 + 1 + 2  # the first fold curve is not traced again


def exit_of(words):
    with pytest.raises(SystemExit) as end:
        main(words)
    return end.value.code


def test_a_jump_map_reports_traces_that_ended_early():
    few = hb.StepControl(max_points=4)
    found = hb.jump_map(DUFFING, "zeta", (0.03, 0.05), frequencies=(0.6, 1.6), harmonics=3, seeds=2, steps=few)
    assert found.status is Status.MAX_POINTS and "ended early" in found.message and "fold" in found.message


def test_critical_does_not_take_half_a_curve_for_a_whole_one():
    def work():
        return hb.analysis.critical_parameter(DUFFING, "zeta", frequencies=(0.6, 1.6), harmonics=3)

    work()
    whole, count = at_call(0, work)
    assert whole.status.complete
    known = [whole.value, *(value for value, _ in whole.others)]
    for part in parts(work, count):
        if part is None:
            continue
        assert part.status is Status.INTERRUPTED and part.value in known


def test_a_survey_keeps_its_branches():
    def work():
        problem = hb.HarmonicBalance(DUFFING, 2)
        return hb.trace_all(problem, (0.9, 1.3), frequencies=1, guesses=2, second=("F", (0.1, 0.3)))

    work()
    whole, count = at_call(0, work)
    assert whole.status.complete
    seen = set()
    for part in parts(work, count):
        if part is None:
            seen.add(0)
            continue
        assert part.status is Status.INTERRUPTED and "interrupted" in part.message
        early = [branch.status is Status.INTERRUPTED for branch in part.branches]
        assert not any(early[:-1])
        for branch, other in zip(part.branches, whole.branches, strict=False):
            assert within(branch, other)
        seen.add(len(part))
    assert seen == {0, 1}


def test_an_error_ends_a_survey_with_its_branches(monkeypatch):
    def broken(*_):
        raise Bug("in the search")

    monkeypatch.setattr("hbgear.analysis.branch_search.multistart.deflated_newton", broken)
    found = hb.trace_all(hb.HarmonicBalance(DUFFING, 2), (0.9, 1.3), frequencies=1)
    assert len(found) == 1 and found.branches[0].status.complete
    assert found.status is Status.FAILED and "Bug: in the search" in found.message and "Omega = 1.1" in found.message


def test_basins_keep_the_starts_that_have_settled():
    def work():
        return hb.time.basins(
            hb.SpurPair(e=(0.1,)), 0.65, (0, 2), (-1, 1), (4, 3), settling=SteadyStateSettings(1e-4, 400)
        )

    work()
    whole, count = at_call(0, work)
    assert whole.status.complete and whole.label.min() == 0
    seen = set()
    for part in parts(work, count, 40):  # few calls are made during the integration
        if part is None:
            seen.add(0)
            continue
        done = part.label >= 0
        if done.all():  # too late to interrupt
            continue
        assert part.status is Status.INTERRUPTED and f"{done.sum()} of 12" in part.message
        for row, column in np.argwhere(done):
            mine, true = part.attractors[part.label[row, column]], whole.attractors[whole.label[row, column]]
            assert mine.period == true.period and mine.rms == pytest.approx(true.rms, rel=1e-6)
        seen.add(int(done.sum()))
    assert 0 in seen and any(0 < k < 12 for k in seen)


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot send SIGINT to itself on Windows")
def test_ctrl_c_is_heard_while_compiled_loops_run_in_threads():
    """Half a million starts take long; the starts of completed batches are kept."""

    def stop(now):
        if now.done > 0.02:
            os.kill(os.getpid(), signal.SIGINT)

    found = hb.time.basins(
        hb.SpurPair(e=(0.1,)), 0.65, shape=(700, 700), settling=SteadyStateSettings(1e-4), progress=stop
    )
    assert found.status is Status.INTERRUPTED and "interrupted" in found.message
    assert 0.01 < np.mean(found.label >= 0) < 0.5
    periods = 100_000
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        ExponentialIntegrator(DUFFING, 1.0).advance(
            ExponentialIntegrator(DUFFING, 1.0).start(np.zeros((200, 2))), periods
        )


# ---- errors in problems and callbacks


class Odd(hb.HarmonicBalance):
    """Raises an error when motions in a range of frequencies are monitored."""

    def observe_many(self, X, name, values, stability=True, **how):
        if ((values > 1.0) & (values < 1.05)).any():
            raise Bug("no multipliers here")
        return super().observe_many(X, name, values, stability, **how)


def test_points_that_cannot_be_observed_are_kept():
    whole = hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", (0.6, 1.6))
    with warnings.catch_warnings(action="error", category=RuntimeWarning):
        part = hb.trace(Odd(DUFFING, 3), "Omega", (0.6, 1.6))
    assert part.status is Status.FAILED and "Bug: no multipliers here (test_interrupt.py, line" in part.message
    assert part.values[-1] == 1.6 and part["LP1"].located
    lost = np.isnan(part.multipliers).all(axis=1)
    inside = (part.values > 1.0) & (part.values < 1.05)
    assert lost.any() and (lost == inside).all() and (part.regime[lost] == -1).all()
    assert part[int(np.flatnonzero(lost)[0])].stable is None
    for label in ("LP1", "LP2"):
        assert part[label].parameters["Omega"] == whole[label].parameters["Omega"]


def test_a_first_point_that_cannot_be_observed_is_refused():
    with pytest.raises(Bug, match="no multipliers"):
        hb.trace(Odd(DUFFING, 3), "Omega", (1.02, 1.6))


@pytest.mark.parametrize(
    "name",
    ["events.detector.EventDetector.find", "tracing.trace.find_jumps", "events.detector.EventDetector.sign_changes"],
)
def test_errors_of_located_points_leave_the_curve(monkeypatch, name):
    def broken(*_):
        raise Bug("while looking")

    monkeypatch.setattr(f"hbgear.continuation.{name}", broken)
    part = hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", (0.6, 1.6))
    assert part.status is Status.FAILED and "Bug: while looking" in part.message and len(part) > 30


def test_exceptions_of_progress_are_raised_with_the_branch():
    def show(now):
        if now.numbers["points"] == 12:
            raise Bug("enough")

    with pytest.raises(Bug, match="enough") as raised:
        hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", (0.6, 1.6), progress=show)
    part = raised.value.branch
    assert len(part) >= 12 and part.status is Status.FAILED and "in progress" in part.message
    assert np.isfinite(part.multipliers).all() and "attribute branch" in raised.value.__notes__[0]


def test_a_fold_curve_starts_from_a_point_of_other_harmonics():
    narrow = hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", (0.6, 1.6), stability=False)
    problem = hb.HarmonicBalance(DUFFING, 5)
    wide = hb.trace(problem, "Omega", (0.6, 1.6), stability=False)
    found = hb.trace(
        hb.continuation.FoldProblem(problem), "zeta", (narrow["LP1"].parameters["zeta"], 0.04), narrow["LP1"]
    )
    assert found.tracked["Omega"][0] == pytest.approx(wide["LP1"].parameters["Omega"], rel=1e-9)
    with pytest.raises(ValueError, match="has 9 unknowns; the problem has 12"):
        hb.trace(hb.continuation.FoldProblem(problem), "zeta", (0.05, 0.04), np.zeros(9))


# ---- signals


def test_a_file_is_written_before_ctrl_c_is_heard(tmp_path):
    path = tmp_path / "a.txt"
    with pytest.raises(KeyboardInterrupt), atomic_write(path, "x") as handle:
        handle.write("half")
        signal.raise_signal(signal.SIGINT)
        handle.write(" and half")
    assert path.read_text() == "half and half" and os.listdir(tmp_path) == ["a.txt"]


def test_the_second_ctrl_c_is_heard_at_once_and_leaves_nothing_behind(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("before")
    with pytest.raises(KeyboardInterrupt), atomic_write(path, "x") as handle:
        handle.write("half")
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        handle.write(" and half")
    assert path.read_text() == "before" and os.listdir(tmp_path) == ["a.txt"]


def test_ctrl_c_does_not_restart_a_long_search(monkeypatch):
    """A fold curve drops the segment whose search for special points is interrupted; `extend` searches it."""
    problem, searches = hb.HarmonicBalance(hb.SpurPair(), 10), []
    start = hb.trace(problem, "Omega", (1.3, 0.8), at={"zeta": 0.117}, stability=False)["LP1"]

    def interrupted(self, arc):
        searches.append(arc)
        raise KeyboardInterrupt

    with monkeypatch.context() as held_up:
        held_up.setattr(SpecialPoints, "_locate", interrupted)
        folds = hb.trace(hb.continuation.FoldProblem(problem), "zeta", (0.117, 0.119), start)
    assert folds.status is Status.INTERRUPTED and len(searches) == 1 and folds.special == ()
    assert folds.values[-1] == searches[0].a.value and len(folds) > 5
    whole = hb.extend(folds)
    assert whole.status.complete and [p.label for p in whole.special] == ["CP1"]


class Stopped(hb.HarmonicBalance):
    """Raises KeyboardInterrupt before the fourth run of the compiled loop."""

    calls = 0

    def compiled_continuation(self, name, parameters):
        loop = super().compiled_continuation(name, parameters)

        def stopped(*arguments):
            self.calls += 1
            if self.calls == 4:
                raise KeyboardInterrupt
            return loop(*arguments)

        return stopped


def test_ctrl_c_skips_segments_with_long_searches(monkeypatch):
    """Each special point takes 0.4 s: of the two on pending segments the second is left to `extend`."""
    monkeypatch.setattr(
        "hbgear.continuation.tracing.stepper.MAX_MULTIPLICATIONS_PER_CALL", 64 * 22**3
    )  # fewer points per call, as for large machines
    span, steps, looked = hb.SpurPair.default_span, hb.StepControl(max_step=0.02), []
    whole = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 10), "Omega", span, steps=steps)
    locate, monotonic = SpecialPoints._locate, time.monotonic

    def slow(self, arc):
        looked.append(arc)
        return locate(self, arc)

    with monkeypatch.context() as held_up:
        held_up.setattr(SpecialPoints, "_locate", slow)
        held_up.setattr(time, "monotonic", lambda: monotonic() + 0.4 * len(looked))
        part = hb.trace(Stopped(hb.SpurPair(), 10), "Omega", span, steps=steps)
    assert part.status is Status.INTERRUPTED and len(looked) == 2
    assert [p.label for p in part.special] == ["GR1", "LP1"] and [p.kind for p in whole.special] == [
        "GR",
        "LP",
        "LP",
        "GR",
    ]
    assert within(part, whole) and np.isfinite(part.multipliers).all() and len(part) == part.special[1].index + 2
    again = hb.extend(part)
    assert again.status.complete and [p.label for p in again.special] == [p.label for p in whole.special]
    there, known = ([p.parameters["Omega"] for p in curve.special] for curve in (again, whole))
    np.testing.assert_allclose(there, known, rtol=1e-9)


def test_ctrl_c_while_pydantic_prepares_a_check_comes_after_it(monkeypatch):
    """An interrupt during the preparation would make its Rust core panic and end the command with a Rust message."""
    pydantic, done = pytest.importorskip("pydantic"), []

    class Adapter(pydantic.TypeAdapter):
        def __init__(self, kind):
            signal.raise_signal(signal.SIGINT)
            super().__init__(kind)
            done.append(kind)

    monkeypatch.setattr(pydantic, "TypeAdapter", Adapter)
    curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 3), "Omega", (1.6, 1.5))
    with pytest.raises(KeyboardInterrupt):
        rebuild_model(curve.meta["model"])
    assert done


def test_sigterm_is_heard_like_ctrl_c():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), sigterm_like_ctrl_c(), defer_signals():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.skipif(os.name == "nt", reason="requires POSIX signals between processes")
@pytest.mark.parametrize("form", ["python -m hbgear", "hbgear"])
@pytest.mark.parametrize("moment", ["numpy", "scipy", "typer"])
def test_ctrl_c_while_the_command_is_imported_gives_one_sentence(tmp_path, form, moment):
    """Ctrl-C arrives while Python imports the first, an intermediate and the last dependency of hbgear."""
    stop = "import os, signal, time; os.kill(os.getpid(), signal.SIGINT); time.sleep(60)"
    (tmp_path / f"{moment}.py").write_text(stop)
    script = tmp_path / "bin" / "hbgear"  # as pip creates it
    script.parent.mkdir()
    script.write_text("import sys; from hbgear.__main__ import main; sys.exit(main())")
    command = ["-m", "hbgear"] if form.startswith("python") else [str(script)]
    where = os.pathsep.join([str(tmp_path), str(Path(ROOT).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    ended = subprocess.run(
        [sys.executable, *command, "trace", "spur-pair"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": where},
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "hbgear: error: stopped before it was done\n")


@pytest.mark.skipif(os.name == "nt", reason="requires POSIX signals between processes")
@pytest.mark.parametrize("moment", ["hbgear.common", "hbgear.common.lazy_names", "typing", "pathlib", "hbgear.cli"])
def test_ctrl_c_gives_one_sentence_from_the_first_import_on(tmp_path, moment):
    """Ctrl-C is handled before any other import: it arrives at the first search for a module."""
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\nclass Stop:\n    @staticmethod\n    def find_spec(name, *rest):\n"
        f"        if name == {moment!r}:\n            raise KeyboardInterrupt\nsys.meta_path.insert(0, Stop)\n"
    )
    script = tmp_path / "hbgear"
    script.write_text("from hbgear.__main__ import main; main()")
    where = os.pathsep.join([str(tmp_path), str(Path(ROOT).parent)])
    ended = subprocess.run(
        [sys.executable, str(script), "models"],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": where},
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "hbgear: error: stopped before it was done\n")


@pytest.mark.skipif(os.name == "nt", reason="requires POSIX signals between processes")
def test_ctrl_c_within_exec_of_a_text_gives_the_exit_code(tmp_path):
    """Dataclasses and named tuples execute a text: Python ended by the signal, although it was handled."""
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\nclass Stop:\n    @staticmethod\n    def find_spec(name, *rest):\n"
        "        if name == 'hbgear.cli':\n            exec('raise KeyboardInterrupt')\nsys.meta_path.insert(0, Stop)\n"
    )
    where = os.pathsep.join([str(tmp_path), str(Path(ROOT).parent)])
    ended = subprocess.run(
        [sys.executable, "-m", "hbgear", "models"],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": where},
    )
    assert (ended.returncode, ended.stderr) == (130, "hbgear: error: stopped before it was done\n")


def test_a_library_hears_ctrl_c_as_python_does(tmp_path):
    (tmp_path / "numpy.py").write_text("raise KeyboardInterrupt")
    where = os.pathsep.join([str(tmp_path), str(Path(ROOT).parent)])
    program = "import hbgear\ntry: hbgear.trace\nexcept KeyboardInterrupt: print('mine')\nhbgear.trace"
    ended = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": where},
    )
    assert ended.stdout == "mine\n" and ended.stderr.startswith("Traceback") and "stopped" not in ended.stderr


COMMANDS = {
    "trace": ["trace", "spur-pair", "-o", "out.npz", "--harmonics", "32"],
    "map": ["map", "spur-pair", "--in", "zeta=0.03:0.1", "-o", "out.csv"],
    "critical": ["critical", "spur-pair", "zeta"],
}
SCRIPT = "import sys; from hbgear.cli.app import main; print('ready', flush=True); main(sys.argv[1:])"


@pytest.mark.skipif(os.name == "nt", reason="requires POSIX signals between processes")
@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_commands_stop_at_any_moment(tmp_path, name, stop):
    for delay in np.random.default_rng(len(name)).uniform(0.1, 1.5, 3):
        folder = tmp_path / f"{delay:.6f}"
        folder.mkdir()
        command = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, *COMMANDS[name]],
            cwd=folder,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert command.stdout.readline() == "ready\n"
        time.sleep(delay)
        command.send_signal(stop)
        out, err = command.communicate(timeout=60)
        if command.returncode == -stop:  # all results were written, and Python was shutting down
            assert "wrote" in out or "the model has" in out
            continue
        assert command.returncode in (0, 3) and "Traceback" not in err, (delay, err)
        assert set(os.listdir(folder)) <= {"out.npz", "out.csv", "out.part.npz"}
        if command.returncode == 3:
            assert "stopped" in err or "interrupted" in out + err
            assert "a jump exists" not in out or "the model has" in out  # complete output or none
        if (folder / "out.npz").exists():
            curve = hb.load(folder / "out.npz")
            assert curve.status.complete or (curve.status is Status.INTERRUPTED and command.returncode == 3)


def test_ctrl_c_ends_a_study_and_leaves_no_figure_of_half_a_curve(tmp_path, monkeypatch, on_path):
    from studies import study

    def run(quick):
        def stop(*_):
            signal.raise_signal(signal.SIGINT)

        hb.trace(hb.HarmonicBalance(DUFFING, 3), "Omega", (0.6, 1.6), progress=stop)

    module = SimpleNamespace(run=run, report=lambda results: "wrong", __file__=str(tmp_path / "one.py"))
    monkeypatch.setitem(sys.modules, "studies.some.one", module)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(SystemExit) as raised:
        study.make("studies.some.one", tmp_path / "out")
    assert raised.value.code == 3 and not os.listdir(tmp_path / "out")
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
def test_the_advice_after_ctrl_c_is_possible():
    """A map, a sweep, basins and a search are not continued by `extend`, which is for curves."""
    after = 3

    def stop(progress):
        calls.append(progress)
        if len(calls) == after:
            raise KeyboardInterrupt

    model = hb.Duffing(zeta=0.2)
    runs = {
        "curves are kept": lambda: hb.jump_map(
            hb.Duffing(), "zeta", (0.05, 0.06), frequencies=(0.9, 1.4), harmonics=1, seeds=2, progress=stop
        ),
        "start=": lambda: hb.time.sweep(model, [0.5, 0.6, 0.7, 0.8], "up", progress=stop),
        "frequencies=": lambda: hb.trace_all(
            hb.HarmonicBalance(model, 3), (0.8, 1.2), frequencies=[1.0], guesses=2, progress=stop
        ),
    }
    for option, run in runs.items():
        calls = []
        part = run()
        assert part.status is Status.INTERRUPTED and "interrupted" in part.message
        assert option in part.message and "extend" not in part.message
    found = hb.time.sweep(model, [0.5, 0.6], "up", progress=None)
    rest = hb.time.sweep(model, [0.7, 0.8], "up", start=found.states[-1])
    assert rest.status.complete
