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
from typing import Any, Callable, Dict, Generator, List, Sequence, Tuple, Union
from typing import Counter as CounterType

from husky_evaluation.tasks.fingerprint import machine
from husky_highlevel_controller.datatypes import HuskyError

Group = Sequence[Any]  # items that are sent to a worker together
# description of the machine that computed a group, and the result of each item of the group
Answer = Tuple[str, List[Any]]
# number of a group, and the group's answer or the error that it caused
Answers = Generator[Tuple[int, Union[Answer, BaseException]], None, None]
SET_PARENT_DEATH_SIGNAL = 1  # option of prctl(2): the system sends this process a signal when its parent ends
# if this number of processes have died while they worked on one group, the group is not tried again, and its
# result is an error
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
    # number of processes that have ended during each group; the key is the number of the group
    deaths: CounterType[int] = Counter()
    while waiting:
        running: Dict[Future, int] = {}  # number of the group whose answer the future will have
        executor: Executor  # pool of threads or processes
        if starts_programs:
            executor = ThreadPoolExecutor(jobs)
        else:
            executor = ProcessPoolExecutor(jobs, get_context("fork"), _end_with_parent)
        try:
            while waiting or running:
                # Each process gets two groups, so that it can begin the second group as soon as it has ended
                # the first one. But a group during which a process has died is sent again only when no other
                # group is running. If a process then dies again, this group is the probable cause.
                while waiting:
                    number = waiting[0]
                    most_running = 1 if deaths[number] else 2 * jobs
                    if len(running) >= most_running:
                        break
                    running[executor.submit(perform, task, groups[number])] = number
                    # removed only after `submit`, because `submit` fails if the pool is broken
                    waiting.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        raise error  # a process has ended; the `except` block below handles this
                    number = running.pop(future)
                    yield number, future.result() if error is None else error
        except BrokenProcessPool:
            # if one process ends, the pool is broken and loses the groups of all its processes; the outer
            # loop makes another pool
            losses = sorted(running.values())
            deaths.update(losses)
            # group with the most deaths; None if no group is lost, because a process has ended before it got
            # a group. The next pool then gets the waiting groups.
            worst = max(losses, key=lambda number: deaths[number], default=None)
            if worst is not None and deaths[worst] >= MAX_DEATHS:
                sentence = f"task {worst + 1} of {len(groups)} ended its process {MAX_DEATHS} times"
                yield worst, HuskyError(sentence)
                losses.remove(worst)
            waiting.extendleft(reversed(losses))  # the lost groups go back to the front, in their order
        finally:
            # `shutdown` waits for the running tasks and cancels the waiting tasks; in Python 3.8 it cannot
            # cancel them, so they run, too. `Future.cancel` is not used, because a pool with cancelled
            # futures may hang at its end (Python 3.11.2, gh-94777)
            if sys.version_info >= (3, 9):
                executor.shutdown(cancel_futures=True)
            else:
                executor.shutdown()


def _end_with_parent() -> None:
    """Prepare a new process: ignore Ctrl-C, which the main process handles, and end with the main process.

    Otherwise the processes of a killed command would continue to compute.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
