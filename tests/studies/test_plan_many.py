"""Many plans: order, bits, errors, dying workers, interrupts, executors of others."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zmp_sqp as zs
from benchmarks.problems.arm import random_problem
from zmp_sqp.studies.parcel import pack, work
from zmp_sqp.studies.progress import _Lines

ROOT = Path(__file__).resolve().parents[2]


def problems(count: int, first: int = 0) -> list[zs.Problem]:
    return [random_problem(seed).problem for seed in range(first, first + count)]


def assert_same(plans: list[zs.Plan], given: list[zs.Problem]) -> None:
    """The plans are those of one process, bit for bit, in the order of the problems."""
    assert len(plans) == len(given)
    for one, problem in zip(plans, given, strict=True):
        alone = zs.plan(problem)
        assert one.problem is problem
        assert one.status is alone.status
        assert one.iterations == alone.iterations
        np.testing.assert_array_equal(one.attempt.positions, alone.attempt.positions)
        np.testing.assert_array_equal(one.attempt.times, alone.attempt.times)
        assert one.certificate.margin == alone.certificate.margin


def fails_in_motion(machine, q, v, a):
    """Values at rest, when the problem is made; an error at all other calls."""
    if len(q) > 1:
        raise MemoryError("out of memory")
    return -np.ones((1, 1)), np.zeros((1, 1, 3 * q.shape[1]))


def with_rows(problem: zs.Problem, function: Any) -> zs.Problem:
    return replace(problem, constraints=[zs.PathRows("broken", function)])


class Once(ThreadPoolExecutor):
    """Executor that ends by itself after a number of calls."""

    def __init__(self, calls: int) -> None:
        super().__init__(1)
        self.calls = calls

    def submit(self, *call, **options) -> Future:
        self.calls -= 1
        if self.calls < 0:
            self.shutdown(wait=False)
        return super().submit(*call, **options)


def test_local_processes_give_the_plans_of_one_process_in_order():
    given = problems(7)
    assert_same(zs.plan_many(given, workers=2, progress=False), given)


def test_plans_as_they_come_with_progress():
    given, seen = problems(5), []
    found = dict(
        zs.plan_many(
            given, ThreadPoolExecutor(2), lambda *done: seen.append(done), as_completed=True
        )
    )
    assert_same([found[i] for i in range(5)], given)
    assert seen == [(i + 1, 5) for i in range(5)]


def test_without_a_terminal_a_line_tells_of_long_work_now_and_then(capsys):
    now = [0.0]
    lines = _Lines(100, clock=lambda: now[0])
    for number in range(100):
        now[0] += 7.0
        lines(success=number % 10 != 0)
    written = capsys.readouterr().err.splitlines()
    assert written[0] == "planned 5 of 100, 1 without a motion; about 665 s to go"
    assert len(written) == 19  # every 35 s, and none at the end


def test_no_problems_take_no_time():
    assert zs.plan_many([]) == []
    assert list(zs.plan_many([], as_completed=True)) == []


def test_an_error_in_one_problem_is_the_plan_of_that_problem():
    given = problems(3)
    spoilt = with_rows(given[1], fails_in_motion)
    plans = zs.plan_many([given[0], spoilt, given[2]], ThreadPoolExecutor(1), progress=False)
    assert_same([plans[0], plans[2]], [given[0], given[2]])
    assert plans[1].status is zs.Status.ERROR
    assert not plans[1].success
    assert "out of memory" in plans[1].message
    with pytest.raises(zs.NotSolved, match="out of memory"):
        _ = plans[1].trajectory


def test_a_problem_that_cannot_be_sent_says_why():
    given = problems(3)
    spoilt = with_rows(given[0], lambda machine, q, v, a: fails_in_motion(machine, q, v, a))
    plans = zs.plan_many([spoilt, *given[1:]], ThreadPoolExecutor(1), progress=False)
    assert_same(plans[1:], given[1:])
    assert plans[0].status is zs.Status.ERROR
    assert "defined in a module" in plans[0].message


def test_an_executor_that_ends_leaves_plans_that_say_so():
    given = problems(6)
    plans = zs.plan_many(given, Once(2), progress=False)
    done = [one for one in plans if one.status is not zs.Status.ERROR]
    assert len(plans) == 6
    assert len(done) == 2
    assert_same(done, given[:2])
    assert all("executor has ended" in one.message for one in plans[2:])


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"problems": [1]}, r"problems\[0\] must be a Problem"),
        ({"problems": 5}, "problems must be Problems, not 5"),
        ({"problems": [], "executor": 5}, r"executor must be .* submit\(\), not 5"),
        ({"problems": [], "workers": 0}, "workers must be at least 1"),
        ({"problems": [], "workers": 1.5}, "workers must be a whole number"),
    ],
)
def test_wrong_arguments_are_refused(arguments, complaint):
    with pytest.raises(zs.ProblemError, match=complaint):
        zs.plan_many(**arguments)


def test_known_machines_do_not_travel():
    given = problems(4)
    machine = given[0].machine
    same = [zs.Problem(machine, one.start, one.goal, one.ground) for one in given[:1] * 4]
    alone, known = (
        len(pack(list(enumerate(same)), machines, "auto", None).content)
        for machines in ([], [machine])
    )
    assert known < 0.5 * alone
    (outcome,) = work(pack([(5, given[0])], [], "auto", None))
    assert outcome.index == 5
    assert outcome.plan.problem is None


SCRIPT = """
    import os, signal, sys, time
    from pathlib import Path
    import numpy as np
    import zmp_sqp as zs
    from benchmarks.problems.arm import random_problem

    here = Path(sys.argv[1])

    def deadly(machine, q, v, a):
        if len(q) > 1:  # not when the problem is made
            os._exit(7)
        return -np.ones((1, 1)), np.zeros((1, 1, 3 * q.shape[1]))

    def deadly_once(machine, q, v, a):
        if len(q) > 1 and not (here / "died").exists():
            (here / "died").touch()
            os._exit(7)
        return -np.ones((len(q), 1)), np.zeros((len(q), 1, 3 * q.shape[1]))

    def slow(machine, q, v, a):
        if len(q) > 1:
            (here / "working").touch()
            time.sleep(0.2)
        return -np.ones((len(q), 1)), np.zeros((len(q), 1, 3 * q.shape[1]))

    def spoilt(one, function):
        rows = [zs.PathRows("deadly", function)]
        return zs.Problem(one.machine, one.start, one.goal, one.ground, constraints=rows)

    if __name__ == "__main__":
        given = [random_problem(seed).problem for seed in range(8)]
        if sys.argv[2] == "dies":
            given[2] = spoilt(given[2], deadly)
            given[4] = spoilt(given[4], deadly_once)
            for one in zs.plan_many(given, workers=2):
                print(one.status.name, "ended 2 times" in one.message)
        else:
            given += [spoilt(one, slow) for one in given] * 3
            try:
                zs.plan_many(given, workers=1)
            except zs.Interrupted as early:
                done = [one is not None for one in early.plans]
                print("interrupted", 0 < sum(done) < len(done))
"""


def run_script(folder: Path, mode: str, **options) -> subprocess.Popen:
    script = folder / "script.py"
    script.write_text(textwrap.dedent(SCRIPT), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, str(script), str(folder), mode],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def test_a_problem_that_ends_its_process_twice_is_given_up_and_no_other_is_lost(tmp_path):
    process = run_script(tmp_path, "dies")
    out, err = process.communicate(timeout=240.0)
    lines = out.splitlines()
    assert len(lines) == 8, err
    assert lines[2] == "ERROR True"
    assert all(
        line.endswith("False") and not line.startswith("ERROR") for line in lines[:2] + lines[3:]
    )


def test_ctrl_c_ends_the_processes_and_leaves_what_was_done(tmp_path):
    process = run_script(tmp_path, "interrupt", start_new_session=True)
    for _ in range(1200):
        if (tmp_path / "working").exists() or process.poll() is not None:
            break
        signal.sigtimedwait([], 0.1)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
    out, err = process.communicate(timeout=120.0)
    assert "interrupted True" in out, err
    assert "Traceback" not in err


def test_a_script_without_a_guard_is_told_what_to_do(tmp_path):
    script = tmp_path / "bare.py"
    script.write_text(
        "import zmp_sqp as zs\nfrom benchmarks.problems.arm import random_problem\n"
        "plans = zs.plan_many([random_problem(0).problem], workers=1)\nprint(plans[0].message)\n",
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(script)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=240.0,
        check=False,
    )
    assert "if __name__ == '__main__':" in done.stderr
    assert "worker process ended 2 times" in done.stdout


def test_dask_workers_give_the_same_bits_though_one_of_them_is_killed():
    distributed = pytest.importorskip("dask.distributed")
    given = problems(24, first=100)
    cluster = distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        silence_logs=50,
    )
    with cluster, distributed.Client(cluster) as client:
        found, killed = {}, False
        for index, one in zs.plan_many(given, client.get_executor(), False, as_completed=True):
            assert index not in found
            found[index] = one
            if not killed:
                killed = True
                pid = next(iter(client.run(os.getpid).values()))
                os.kill(pid, signal.SIGKILL)
    assert_same([found[i] for i in range(24)], given)
