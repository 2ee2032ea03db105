"""Groups of tasks on this machine: by processes, or by threads if a task starts other programs.

In: a function, groups of items. Out: their results as they come.
"""

from __future__ import annotations

import ctypes
import signal
import sys
from collections import Counter, deque
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import Any, Callable, Deque, Dict, Generator, List, Mapping, Sequence, Tuple, Union
from typing import Counter as CounterType

from husky_evaluation.tasks.fingerprint import machine
from husky_highlevel_controller.datatypes import HuskyError

Group = Sequence[Any]  # items that are sent to a worker together
# description of the machine that computed a group, and the result of each item of the group
Answer = Tuple[str, List[Any]]
# number of a group, and the group's answer or the error that it caused
Answers = Generator[Tuple[int, Union[Answer, BaseException]], None, None]
SET_PARENT_DEATH_SIGNAL = 1  # option of prctl(2): the system sends this process a signal when its parent ends
# if a process has died this number of times while a group was in the pool, the group is not tried again, and
# its answer is an error
MAX_DEATHS = 3


def perform(task: Callable[[Any], Any], group: Group) -> Answer:
    """Do a group of tasks in a worker; return the machine's description, and the results."""
    return machine(), [task(item) for item in group]


def run_here(
    task: Callable[[Any], Any], groups: Sequence[Group], jobs: int, starts_programs: bool
) -> Answers:
    """Yield number and answer of each group, in the order in which the answers come.

    If a task raises an exception, this exception is the answer of its group. A killed process is replaced,
    and its group is done again. The answer of a group that ends its process MAX_DEATHS times is a HuskyError.
    Closing the iterator cancels the other groups.

    Args:
        task: function of one item.
        groups: items of each group.
        jobs: number of processes, or of threads.
        starts_programs: the task starts other programs, so threads that wait for these are enough.
    """
    waiting = deque(range(len(groups)))  # numbers of the groups that are still to be sent
    # number of times that a process has died while the group was in the pool; the key is the group's number
    deaths: CounterType[int] = Counter()
    while waiting:
        pool: Executor  # threads or processes
        if starts_programs:
            pool = ThreadPoolExecutor(jobs)
        else:
            pool = ProcessPoolExecutor(jobs, get_context("fork"), _end_with_parent)
        running: Dict[Future, int] = {}  # number of the group whose answer the future will have
        try:
            yield from _answers_of_pool(pool, task, groups, 2 * jobs, waiting, running, deaths)
        except BrokenProcessPool:
            # A process has died. The pool is then broken, and all groups in the pool are lost. They go back
            # to the front, in their order, and the next round makes another pool.
            lost = sorted(running.values())
            deaths.update(lost)  # each lost group may be the cause, so each of them gets one more death
            at_limit = [number for number in lost if deaths[number] >= MAX_DEATHS]
            if at_limit:
                # only the group with the most deaths is given up, because it is the most probable cause
                worst = max(at_limit, key=lambda number: deaths[number])
                sentence = f"task {worst + 1} of {len(groups)} ended its process {MAX_DEATHS} times"
                yield worst, HuskyError(sentence)
                lost.remove(worst)
            waiting.extendleft(reversed(lost))
        finally:
            _shut_down(pool)


def _answers_of_pool(
    pool: Executor,
    task: Callable[[Any], Any],
    groups: Sequence[Group],
    max_running: int,
    waiting: Deque[int],
    running: Dict[Future, int],
    deaths: Mapping[int, int],
) -> Answers:
    """Send the waiting groups to a pool, and yield number and answer of each group.

    Args:
        pool: threads or processes.
        task: function of one item.
        groups: items of each group.
        max_running: largest number of groups in the pool: two for each process, so that a process can begin
            the second group as soon as it has ended the first one.
        waiting: numbers of the groups to send; a group that is sent is removed.
        running: number of the group of each future. Groups that are sent are added, and groups that are
            answered are removed, so that the caller knows the lost groups if the pool breaks.
        deaths: number of times that a process has died while the group was in the pool; the key is the number
            of the group.

    Raises:
        BrokenProcessPool: a process has died.
    """
    while waiting or running:
        while waiting:
            number = waiting[0]
            # If a process dies, each group in the pool may be the cause. Such a group runs again, but it is
            # sent only into an empty pool, so that no two of them run at the same time. Groups without a
            # death may join it. If a process dies again, the group with more deaths is the cause.
            may_be_cause = deaths[number] > 0
            has_room = not running if may_be_cause else len(running) < max_running
            if not has_room:
                break
            running[pool.submit(perform, task, groups[number])] = number
            waiting.popleft()  # only after `submit`, because `submit` fails if the pool is broken
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                raise error
            number = running.pop(future)
            yield number, future.result() if error is None else error


def _shut_down(pool: Executor) -> None:
    """Wait for the running tasks of a pool, and cancel its waiting tasks.

    Python 3.8 cannot cancel the waiting tasks, so they run, too. `Future.cancel` is not used, because a pool
    with cancelled futures may hang at its end (Python 3.11.2, gh-94777).
    """
    if sys.version_info >= (3, 9):
        pool.shutdown(cancel_futures=True)
    else:
        pool.shutdown()


def _end_with_parent() -> None:
    """Prepare a new process: ignore Ctrl-C, which the main process handles, and end with the main process.

    Otherwise the processes of a killed command would continue to compute.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
