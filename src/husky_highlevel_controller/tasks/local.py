"""Groups of tasks on this machine: by processes, or by threads where a task starts programs of its own.

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
from typing import Any, Callable, Dict, Generator, List, Optional, Sequence, Tuple
from typing import Counter as CounterType

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.tasks.fingerprint import machine

Group = Sequence[Any]  # items that are sent to a worker together
OnError = Callable[[Any, Exception], Any]  # result of an item whose task has failed; or it raises
Answer = Tuple[str, List[Any]]  # the machine that computed, and the result of each item of a group
SET_PARENT_DEATH_SIGNAL = 1  # of prctl(2)
MAX_DEATHS = 3  # of processes under one group; then it is its fault


def perform(task: Callable[[Any], Any], group: Group) -> Answer:
    """Do a group of tasks, in a worker."""
    return machine(), [task(item) for item in group]


def failure(group: Group, error: Exception, on_error: Optional[OnError]) -> Answer:
    """Answer for a group whose task has failed; without `on_error` the error is raised."""
    if on_error is None:
        raise error
    return machine(), [on_error(item, error) for item in group]


def run_here(
    task: Callable[[Any], Any],
    groups: Sequence[Group],
    jobs: int,
    starts_programs: bool,
    on_error: Optional[OnError] = None,
) -> Generator[Tuple[int, Answer], None, None]:
    """The number of each group and its answer, in the order in which they end.

    A process that is killed is replaced, and its group done again; closing the iterator cancels the others.

    Raises:
        HuskyError: one group ended its process MAX_DEATHS times, without `on_error`.
    """
    todo = deque(range(len(groups)))
    deaths: CounterType[int] = Counter()
    while todo:
        running: Dict[Future, int] = {}
        executor = _executor(jobs, starts_programs)
        try:
            while todo or running:
                # what ended a process is tried alone first, so that nothing else gets the blame
                while todo and len(running) < (1 if deaths[todo[0]] else 2 * jobs):
                    running[executor.submit(perform, task, groups[todo[0]])] = todo[0]
                    todo.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    try:
                        answer: Answer = future.result()
                    except BrokenProcessPool:
                        raise
                    except Exception as error:
                        answer = failure(groups[running[future]], error, on_error)
                    yield running.pop(future), answer
        except BrokenProcessPool:
            losses = sorted(running.values())
            deaths.update(losses)
            worst = max(losses, key=lambda number: deaths[number], default=0)
            if deaths[worst] >= MAX_DEATHS:
                sentence = f"task {worst + 1} of {len(groups)} ended its process {MAX_DEATHS} times"
                yield worst, failure(groups[worst], HuskyError(sentence), on_error)
                losses.remove(worst)
            todo.extendleft(reversed(losses))
        finally:
            _end(executor)


def _end(executor: Executor) -> None:
    """Wait for what runs; what waits is cancelled, on Python 3.8 done.

    Not by Future.cancel: a pool that is shut down over cancelled futures may hang (Python 3.11.2, gh-94777).
    """
    if sys.version_info >= (3, 9):
        executor.shutdown(cancel_futures=True)
    else:
        executor.shutdown()


def _executor(jobs: int, starts_programs: bool) -> Executor:
    if starts_programs:
        return ThreadPoolExecutor(jobs)
    return ProcessPoolExecutor(jobs, get_context("fork"), _obey_the_first)


def _obey_the_first() -> None:
    """Ctrl-C reaches every process of a terminal, but the first one decides; who kills it, kills all."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
