"""Results that are kept in a file, so the same command can resume.

In: results by fingerprint. Out: the same results, in a later process.

The file has pickles, so open only a file that this package wrote for you.
"""

from __future__ import annotations

import pickle
import sqlite3
from pathlib import Path
from typing import Any, Dict

from husky_highlevel_controller.datatypes import HuskyError

RESULTS = "results.sqlite"  # name of the file with the kept results, in a command's output folder


class Store:
    """File of results; a saved result survives even if the process is killed at once."""

    def __init__(self, path: Path) -> None:
        """Open or create the file.

        Raises:
            HuskyError: the file is of another kind, or cannot be written.
        """
        self._path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = sqlite3.connect(str(path))
            try:
                # `connect` does not read the file, so an existing file of another kind causes an error here
                self._file.execute("CREATE TABLE IF NOT EXISTS results (key TEXT PRIMARY KEY, result BLOB)")
            except sqlite3.Error:
                self._file.close()  # otherwise the file would stay open
                raise
        except (sqlite3.Error, OSError) as error:
            raise HuskyError(f"{path} cannot keep results: {error}") from error

    def load(self, key: str) -> Any:
        """Return the result, or None if there is none."""
        row = self._file.execute("SELECT result FROM results WHERE key = ?", (key,)).fetchone()
        return pickle.loads(row[0]) if row else None

    def save(self, results: Dict[str, Any]) -> None:
        """Keep results.

        Raises:
            HuskyError: the results cannot be written, for example on a full disk.
        """
        rows = [(key, pickle.dumps(result)) for key, result in results.items()]
        try:
            with self._file:  # one transaction, so that either all results are kept or none
                self._file.executemany("INSERT OR REPLACE INTO results VALUES (?, ?)", rows)
        except sqlite3.Error as error:
            raise HuskyError(f"{self._path} cannot keep results: {error}") from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()
