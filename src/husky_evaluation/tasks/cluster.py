"""Groups of tasks on a Dask cluster. The only module that loads Dask, which is optional.

In: the address of a scheduler, a function, groups of items. Out: their results as they come.

A worker gets work only after a check: it must have this Python and this version of the package, and one
thread, because two threads in one simulator change each other's results. Tasks need no shared files.
"""

from __future__ import annotations

import asyncio
import pickle
import sys
import time
import warnings
from collections import deque
from concurrent.futures import CancelledError
from functools import partial
from math import inf
from typing import Any, Callable, Deque, Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Union

from husky_evaluation.tasks.fingerprint import OURS, code_version
from husky_evaluation.tasks.local import Answers, Group, GroupAnswer, perform
from husky_highlevel_controller.datatypes import HuskyError

try:
    import cloudpickle
    from distributed import Client, Future, KilledWorker, wait
    from distributed.comm import CommClosedError
except ImportError as missing:
    raise HuskyError(
        f"--cluster needs Dask ({missing}). Run pip install -r requirements/cluster.txt; if you use ./dev, "
        "write ./dev run before it. See docs/cluster.md"
    ) from None

CONNECT_DEADLINE = 20.0  # [s] longest wait for the scheduler's answer
WORKER_DEADLINE = 600.0  # [s] longest wait for a first worker that passes the check
POLL_PERIOD = 1.0  # [s] time between two updates of the list of workers
OUR_PACKAGE = __name__.split(".")[0]
ROS = "ROS"  # name of the Dask resource that a worker has if ROS programs can be started on it


class _Run(NamedTuple):
    """Group of tasks that was sent to the scheduler and has not ended."""

    number: int  # number of the group
    workers: FrozenSet[str]  # addresses of the workers that may compute the group


class Cluster:
    """Connection to a scheduler, and the set of its workers that may be used."""

    def __init__(self, address: str) -> None:
        """Connect to a scheduler.

        Raises:
            HuskyError: no scheduler answers.
        """
        self._address = address
        self._refused: Dict[str, str] = {}  # reason of each rejected worker; the key is the worker's address
        # addresses of the workers that have passed the check of threads, Python and version
        self._fit: FrozenSet[str] = frozenset()
        try:
            self._client: Any = Client(address, timeout=CONNECT_DEADLINE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise HuskyError(f"--cluster {address}: no Dask scheduler answers: {error}") from None

    def close(self) -> None:
        """Disconnect; the cluster continues to run."""
        self._client.close(timeout=CONNECT_DEADLINE)

    def run(self, task: Callable[[Any], Any], groups: Sequence[Group], starts_programs: bool) -> Answers:
        """Yield number and answer of each group, in the order in which the answers come.

        If a task raises an exception, this exception is the answer of its group. Other workers take over the
        tasks of a lost worker. Closing the iterator cancels all waiting tasks.

        Args:
            task: function of one item.
            groups: items of each group.
            starts_programs: the task starts ROS, so it needs a worker that has the resource ROS.

        Raises:
            HuskyError: no worker can do the tasks, or the scheduler has gone.
        """
        _send_by_value(task)
        waiting: Deque[int] = deque(range(len(groups)))  # numbers of the groups that are still to be sent
        running: Dict[Future, _Run] = {}
        looked_at = -inf  # [s] time of the last update of the list of workers
        try:
            while waiting or running:
                if time.monotonic() - looked_at >= POLL_PERIOD:
                    workers, looked_at = self._wait_for_workers(starts_programs), time.monotonic()
                    # the groups of lost workers are sent again, to other workers
                    waiting.extendleft(_take_back(running, workers))
                # each worker gets two groups, so that it can begin the second group as soon as it has ended
                # the first one
                while waiting and len(running) < 2 * len(workers):
                    number = waiting.popleft()
                    try:
                        payload = cloudpickle.dumps((task, groups[number]))
                    except Exception as error:
                        # the pickling of a task may raise any error, for example if a file cannot be read
                        yield number, error
                        continue
                    running[self._submit(payload, workers, starts_programs)] = _Run(number, workers)
                # waits at most POLL_PERIOD, so that the list of workers is updated even if no group ends
                for future in self._ended(running):
                    number = running.pop(future).number
                    yield number, _answer_of(future, f"task {number + 1} of {len(groups)}")
        except (CommClosedError, CancelledError, OSError) as error:
            raise HuskyError(f"--cluster {self._address}: the scheduler has gone: {error}") from None
        finally:
            for future in running:
                future.cancel()

    def _submit(self, payload: bytes, workers: FrozenSet[str], starts_programs: bool) -> Future:
        """Send a packed group of tasks to one of these workers, and return the future of its answer."""
        resources = {ROS: 1} if starts_programs else None
        with warnings.catch_warnings():
            # Dask warns of large tasks, but the files of a student's submission may have some megabytes
            warnings.simplefilter("ignore", UserWarning)
            # with pure=False, Dask computes two equal groups separately, and each of them has its own future
            return self._client.submit(
                perform_packed, payload, workers=sorted(workers), resources=resources, pure=False
            )

    def _ended(self, running: Dict[Future, _Run]) -> List[Future]:
        """Wait at most POLL_PERIOD, and return the tasks that have ended."""
        try:
            # `wait` uses the current client, and our client is not the default one
            with self._client.as_current():
                return list(wait(list(running), timeout=POLL_PERIOD, return_when="FIRST_COMPLETED").done)
        except asyncio.TimeoutError:  # no task has ended
            return []

    def _wait_for_workers(self, starts_programs: bool) -> FrozenSet[str]:
        """Wait for workers that may be used, and return them.

        Raises:
            HuskyError: all workers are rejected, or no worker came in time.
        """
        end = time.monotonic() + WORKER_DEADLINE
        while True:
            # descriptions of all connected workers, by their addresses; -1 asks for all workers
            infos = self._client.scheduler_info(n_workers=-1)["workers"]
            self._check({address: info for address, info in infos.items() if address not in self._refused})
            # a worker that has passed the check may have left since then
            fit_workers = self._fit & set(infos)
            workers = fit_workers
            if starts_programs:
                workers = frozenset(each for each in workers if ROS in infos[each].get("resources", {}))
            if workers:
                return workers
            # waiting ends with an error if no connected worker can do the tasks
            if infos and set(infos) <= set(self._refused):
                raise HuskyError(f"--cluster {self._address}: every worker is rejected, see above")
            if fit_workers:
                raise HuskyError(
                    f"--cluster {self._address}: no worker has the resource {ROS}; start one with "
                    f"--resources {ROS}=1"
                )
            if time.monotonic() > end:
                raise HuskyError(
                    f"--cluster {self._address}: no worker connected within {WORKER_DEADLINE:g} s; start one"
                )
            time.sleep(POLL_PERIOD)

    def _check(self, infos: Dict[str, Dict[str, Any]]) -> None:
        """Add each new worker that answers to `_fit` or `_refused`, and print the rejected ones.

        `infos` has the scheduler's description of each worker that is not rejected, by the worker's address.
        """
        new = [address for address in infos if address not in self._fit]
        if not new:
            return
        # versions of Python and of libraries on each worker; the key is the worker's address
        pythons = self._client.get_versions()["workers"]
        for address in new:
            python = pythons.get(address, {}).get("host", {}).get("python", "")
            reason = self._reason_against(address, infos[address]["nthreads"], python)
            if reason is None:  # the worker does not answer, so it is checked again later
                continue
            if reason:
                name = infos[address].get("name", address)
                print(f"worker {name} at {address} is rejected: {reason}", file=sys.stderr)
                self._refused[address] = reason
            else:
                self._fit |= {address}

    def _reason_against(self, address: str, threads: int, python: str) -> Optional[str]:
        """Return why a worker may not be used, by its threads, its Python and its version of the package.

        Returns:
            The reason as the end of a sentence, an empty text if the worker may be used, or None if the
            worker does not answer, so it must be checked again later.
        """
        if threads != 1:
            return f"it has {threads} threads; start it with --nthreads 1"
        if not python:  # the worker has not answered with its versions
            return None
        # major and minor version must agree; `python` is a text such as 3.11.2.final.0
        if python.split(".")[:2] != [str(part) for part in sys.version_info[:2]]:
            return f"its Python is {python.split('.final')[0]}, here it is {sys.version.split()[0]}"
        version = self._version_of(address)  # version, or why there is none; empty if the worker has gone
        if not version:
            return None
        if version != code_version():
            return f"{version}; here it is {code_version()}"
        return ""

    def _version_of(self, address: str) -> str:
        """Return a worker's version of the package, or why it has none; empty if the worker has left."""
        try:
            version = self._client.run(_version_reader(OUR_PACKAGE), workers=[address]).get(address, "")
        except OSError:
            return ""
        except Exception as error:
            # the code on the worker may raise any error, and other workers may still be usable
            return f"its {OUR_PACKAGE} cannot be read: {type(error).__name__}: {error}"
        return str(version)


def _take_back(running: Dict[Future, _Run], usable_now: FrozenSet[str]) -> List[int]:
    """Cancel and remove the groups whose workers have all left, and return the numbers of these groups.

    The scheduler gives a group only to the workers that were usable when the group was sent. If all of them
    have left, the scheduler would wait for them without an end. `usable_now` has the addresses of the workers
    that are connected now and may be used.
    """
    lost = [future for future, run in running.items() if not run.workers & usable_now]
    for future in lost:
        future.cancel()
    return [running.pop(future).number for future in lost]


def _send_by_value(task: Callable[[Any], Any]) -> None:
    """Let cloudpickle send the code of a task's module, unless the worker can import it by its name.

    Without this, a task in the user's own file would fail on a worker, which does not have the file.
    """
    while isinstance(task, partial):
        task = task.func
    module: Any = sys.modules.get(getattr(task, "__module__", ""))
    if not hasattr(module, "__file__"):
        return  # a module without a file has no code that could be sent
    package = module.__name__.split(".")[0]
    is_installed = "-packages" in str(module.__file__)  # the module is in site-packages or dist-packages
    is_importable = is_installed or package in OURS
    # cloudpickle sends the code of the module `__main__` in any case
    if not is_importable and package != "__main__":
        cloudpickle.register_pickle_by_value(module)


def perform_packed(payload: bytes) -> bytes:
    """Do a group of tasks on a worker; the scheduler only sees bytes."""
    task, group = pickle.loads(payload)
    return pickle.dumps(perform(task, group))


def _answer_of(future: Future, title: str) -> Union[GroupAnswer, BaseException]:
    """Return the answer of a group that has ended, or the error; `title` names the group in the error."""
    if future.status != "error":
        return _unpacked(future.result())
    failure: BaseException = future.exception()
    if isinstance(failure, KilledWorker):
        return HuskyError(f"every worker that did {title} ended: {failure}")
    return failure


def _unpacked(payload: bytes) -> Union[GroupAnswer, BaseException]:
    """Return a worker's answer, or the exception if the answer cannot be unpickled.

    The exception is not raised here, so that the other tasks continue.
    """
    try:
        answer: GroupAnswer = pickle.loads(payload)
    except Exception as error:  # unpickling runs code of classes, so it may raise any error
        return error
    return answer


def _version_reader(package: str) -> Callable[[], str]:
    """Return a function that a worker runs to return its version of the package, or why it has none.

    The function is nested and has its imports inside. So it is sent by its code, and a worker can run it
    without the package.
    """

    def ask() -> str:
        import importlib

        try:
            importlib.import_module(package)
        except ImportError:
            return f"it has no package {package}"
        try:
            version = importlib.import_module(f"{package}.tasks.fingerprint").code_version()
            return str(version)
        except ImportError:
            return f"its {package} is an older version"

    return ask
