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
from typing import Any, Callable, Deque, Dict, Generator, List, NamedTuple, Sequence, Tuple, Union
from typing import Counter as CounterType

from husky_evaluation.tasks.fingerprint import machine
from husky_highlevel_controller.datatypes import HuskyError

Group = Sequence[Any]  # items that are sent to a worker together


class GroupAnswer(NamedTuple):
    """Results of a group of items, and the machine that computed them."""

    machine: str  # description of the machine
    results: List[Any]  # result of each item of the group


# number of a group, and the group's answer or the error that it caused
Answers = Generator[Tuple[int, Union[GroupAnswer, BaseException]], None, None]
SET_PARENT_DEATH_SIGNAL = 1  # option of prctl(2): the system sends this process a signal when its parent ends
MAX_DEATHS = 3  # a group is given up when it may have caused this number of deaths of processes


def perform(task: Callable[[Any], Any], group: Group) -> GroupAnswer:
    """Do a group of tasks in a worker; return the machine's description, and the results."""
    return GroupAnswer(machine(), [task(item) for item in group])


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
    # If a process dies, each group in the pool may be the cause. These groups are sent again, each one alone
    # to a new pool, so that another death has only one possible cause.
    suspects: Deque[int] = deque()  # numbers of these groups
    deaths: CounterType[int] = Counter()  # number of deaths that each group may have caused
    while suspects or waiting:
        to_send = deque([suspects.popleft()]) if suspects else waiting
        pool: Executor  # threads or processes
        if starts_programs:
            pool = ThreadPoolExecutor(jobs)
        else:
            pool = ProcessPoolExecutor(jobs, get_context("fork"), _end_with_parent)
        try:
            for number, answer in _answers_of_pool(pool, task, groups, 2 * jobs, to_send):
                if not isinstance(answer, BrokenProcessPool):
                    yield number, answer
                    continue
                deaths[number] += 1
                if deaths[number] < MAX_DEATHS:
                    suspects.append(number)
                else:
                    sentence = f"task {number + 1} of {len(groups)} ended its process {MAX_DEATHS} times"
                    yield number, HuskyError(sentence)
        finally:
            _shut_down(pool)


def _answers_of_pool(
    pool: Executor,
    task: Callable[[Any], Any],
    groups: Sequence[Group],
    max_running: int,
    waiting: Deque[int],
) -> Answers:
    """Send the waiting groups to a pool, and yield number and answer of each group that was sent.

    If a process dies, all groups in the pool are lost, and no further group is sent. The answer of each lost
    group is a BrokenProcessPool.

    Args:
        pool: threads or processes.
        task: function of one item.
        groups: items of each group.
        max_running: largest number of groups in the pool: two for each process, so that a process can begin
            the second group as soon as it has ended the first one.
        waiting: numbers of the groups to send; a group that is sent is removed.
    """
    running: Dict[Future, int] = {}  # calls in the pool, each with the number of its group
    try:
        while waiting or running:
            while waiting and len(running) < max_running:
                future = pool.submit(perform, task, groups[waiting[0]])
                running[future] = waiting.popleft()  # only after `submit`, which fails if a process has died
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                error = future.exception()
                if isinstance(error, BrokenProcessPool):
                    raise error
                number = running.pop(future)
                yield number, future.result() if error is None else error
    except BrokenProcessPool as death:
        for number in sorted(running.values()):
            yield number, death


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
    # A pool ends its processes by SIGTERM. If the main process has a Python handler for it, the handler could
    # raise an error in a process that holds a lock of the pool, and the pool would wait forever for the lock.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
