"""Maps a pure task over items, by this machine's processes or by a Dask cluster, with the same results.

In: a function, its items. Out: results in order, their hash, the machines that computed them.
"""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path
from typing import (
    Any,
    Callable,
    Generator,
    Iterable,
    Iterator,
    List,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
)

from husky_evaluation.tasks.fingerprint import code_version, fingerprint, machine
from husky_evaluation.tasks.local import GroupAnswer, run_here
from husky_evaluation.tasks.store import Store
from husky_evaluation.tasks.task_progress import Progress
from husky_highlevel_controller.datatypes import HuskyError

Task = Callable[[Any], Any]
# function that returns a result for an item whose task failed, or raises an error
OnError = Callable[[Any, Exception], Any]


class Kept(NamedTuple):
    """Result that was kept in a file."""

    machine: str  # description of the machine that has computed the result
    result: Any  # result of the task


class Workers:
    """Processes that do the tasks; a context manager."""

    def __init__(self, jobs: int = 2, cluster: str = "", resume: Optional[Path] = None) -> None:
        """Prepare processes of this machine, or connect to the workers of a Dask cluster.

        Args:
            jobs: number of processes of this machine; without effect on a cluster.
            cluster: address of the Dask scheduler, such as tcp://host:8786; empty for this machine.
            resume: file that keeps the results, so that they are not computed again; None keeps no results.

        Raises:
            HuskyError: Dask is not installed, no scheduler answers, or the file is another kind of file.
        """
        if jobs < 1:
            raise HuskyError(f"jobs = {jobs} is less than 1")
        self.jobs = jobs
        self._store = Store(resume) if resume else None  # None if no results are kept
        self._digest = hashlib.sha256()  # hash of all results of `map`
        self._machines: Set[str] = set()  # descriptions of the machines that have computed results
        self._cluster = None  # None if this machine does the tasks
        if cluster:
            # imported only now, because it needs Dask, which is optional
            from husky_evaluation.tasks.cluster import Cluster

            self._cluster = Cluster(cluster)

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: Any) -> None:
        """Disconnect from the cluster, and close the file of kept results.

        Processes of this machine have ended at the end of each `map`.
        """
        if self._cluster:
            self._cluster.close()
        if self._store:
            self._store.close()

    def map(
        self, task: Task, items: Iterable[Any], title: str = "", chunk: int = 1, starts_programs: bool = False
    ) -> List[Any]:
        """Return the task's result for each item, in order; progress goes to standard error.

        Args:
            task: function of one item without side effects; task and items can be pickled.
            items: arguments of the calls.
            title: name of the tasks in the progress.
            chunk: number of items that are sent to a worker at once; use more for tasks of milliseconds.
            starts_programs: the task starts ROS, so it runs in a thread of this process, or on workers of the
                cluster that have the resource ROS.

        Raises:
            HuskyError: a worker cannot do a task. Exceptions of the task are raised, too.
        """
        items = list(items)
        results = dict(self.as_completed(task, items, title, chunk, starts_programs))
        ordered = [results[number] for number in range(len(items))]
        # the results are hashed in the order of the items, so `results_hash` does not depend on the order in
        # which they came
        self._digest.update(fingerprint(ordered).encode())
        return ordered

    def as_completed(
        self,
        task: Task,
        items: List[Any],
        title: str = "",
        chunk: int = 1,
        starts_programs: bool = False,
        on_error: Optional[OnError] = None,
    ) -> Iterator[Tuple[int, Any]]:
        """Yield the index and the result of each item, in the order in which the results come.

        So the caller can use a result before all tasks have ended, and can go on after an error.

        Args:
            task: function of one item without side effects; task and items can be pickled.
            items: arguments of the calls.
            title: name of the tasks in the progress.
            chunk: number of items that are sent to a worker at once, as a group.
            starts_programs: the task starts ROS, so it runs in a thread of this process, or on workers of the
                cluster that have the resource ROS.
            on_error: function that returns a result for an item whose task has raised an exception, could not
                be sent, or has ended its worker. It gets the item and the exception. An exception counts for
                all items of its group. The result of `on_error` is kept like other results, so a later run
                with the same file does not try the item again. Without `on_error`, the exception is raised.
        """
        keys = self._keys(task, items)
        to_compute: List[int] = []  # indices of the items that have no kept result
        with Progress(len(items), title) as progress:
            for index, key in enumerate(keys):
                kept = self._load(key)
                if kept is None:
                    to_compute.append(index)
                    continue
                progress.update()
                yield index, kept.result
            # a group has the indices of the items that a worker gets together
            groups = [to_compute[first : first + chunk] for first in range(0, len(to_compute), chunk)]
            computed = self._compute(task, items, groups, starts_programs, on_error)
            with closing(computed):  # `closing` cancels the waiting groups after an error in this block
                for group, answer in computed:
                    self._save([keys[index] for index in group], answer)
                    progress.update(len(group))
                    yield from zip(group, answer.results)

    def _compute(
        self,
        task: Task,
        items: Sequence[Any],
        groups: Sequence[List[int]],
        starts_programs: bool,
        on_error: Optional[OnError],
    ) -> Generator[Tuple[List[int], GroupAnswer], None, None]:
        """Send groups of items to the workers, and yield each group with its answer, as the answers come.

        Args:
            task: function of one item.
            items: all items.
            groups: for each group, the indices of its items.
            starts_programs: the task starts ROS.
            on_error: function that returns a result for each item of a group that failed; None raises the
                exception.
        """
        items_of_groups = [[items[index] for index in group] for group in groups]
        if self._cluster:
            answers = self._cluster.run(task, items_of_groups, starts_programs)
        else:
            answers = run_here(task, items_of_groups, self.jobs, starts_programs)
        with closing(answers):
            for number, answer in answers:
                if isinstance(answer, BaseException):  # the group has failed
                    answer = _answer_to_error(answer, items_of_groups[number], on_error)
                yield groups[number], answer

    def _keys(self, task: Task, items: Sequence[Any]) -> List[str]:
        """Return the key of each item's result in the store; empty texts if no results are kept.

        A key depends on the code and the item, so a result is computed again if the code has changed.
        """
        if self._store is None:
            return [""] * len(items)
        code = fingerprint((code_version(), task))
        return [fingerprint((code, item)) for item in items]

    def _load(self, key: str) -> Optional[Kept]:
        """Return the kept result with this key, and note its machine; None if there is no such result."""
        stored = self._store.load(key) if self._store else None
        if stored is None:
            return None
        kept = Kept(*stored)
        self._machines.add(kept.machine)
        return kept

    def _save(self, keys: Sequence[str], answer: GroupAnswer) -> None:
        """Note the machine of an answer, and keep its results by these keys if results are kept."""
        self._machines.add(answer.machine)
        if self._store:
            self._store.save({key: (answer.machine, result) for key, result in zip(keys, answer.results)})

    @property
    def results_hash(self) -> str:
        """Return the SHA-256 of all results of all maps so far, independent of the machines."""
        return str(self._digest.hexdigest())

    @property
    def summary(self) -> str:
        """Return, for a report, the hash of the results and the kinds of machines that computed them."""
        kinds = sorted(self._machines)
        machines = "; ".join(kinds)
        if len(kinds) > 1:
            machines = f"{len(kinds)} kinds of machines, whose last bits may differ: {machines}"
        return f"results {self.results_hash} by {machines}"


def _answer_to_error(error: BaseException, items: Sequence[Any], on_error: Optional[OnError]) -> GroupAnswer:
    """Return the answer for a group of items that failed: this machine, and the results of `on_error`.

    The error is raised if there is no `on_error`, or if it is not the task's own error, but for example a
    KeyboardInterrupt.
    """
    if on_error is None or not isinstance(error, Exception):
        raise error
    return GroupAnswer(machine(), [on_error(item, error) for item in items])
