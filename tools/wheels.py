"""Where `pip install .` finds a wheel of everything, and where it compiles: the table of docs/install.md.

Asks PyPI, for each system and Python, which versions a resolver would install. Wheels are not fetched.

Usage: ./dev run python tools/wheels.py
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
PYTHONS = ("3.8", "3.9", "3.10", "3.11", "3.12", "3.13", "3.14")
SYSTEMS = {
    "Linux, x86_64": "x86_64-unknown-linux-gnu",
    "Linux, arm64": "aarch64-unknown-linux-gnu",
    "macOS, arm64": "aarch64-apple-darwin",
    "macOS, Intel": "x86_64-apple-darwin",
    "Windows, x86_64": "x86_64-pc-windows-msvc",
}


def resolve(requirements: list[str], system: str, python: str) -> str | None:
    """Return the versions that a resolver chooses if all packages must have wheels; None if it fails."""
    command = [
        "uv",
        "pip",
        "compile",
        "--quiet",
        "--only-binary",
        ":all:",
        "-",
        "--no-header",
        "--no-annotate",
    ]
    done = subprocess.run(
        [*command, "--python-version", python, "--python-platform", SYSTEMS[system]],
        input="\n".join(requirements),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode and "No solution found" not in done.stderr:
        raise SystemExit(f"PyPI did not answer for {system} and Python {python}:\n{done.stderr}")
    return None if done.returncode else done.stdout


def cell(requirements: list[str], system: str, python: str) -> str:
    """Return a cell: the name of PyBullet's package if all packages have wheels, or what pip compiles."""
    found = resolve(requirements, system, python)
    if found is not None:  # either pybullet or pybullet_arm64
        return re.search(r"^pybullet[\w-]*", found, re.MULTILINE)[0].replace("-", "_")  # type: ignore[index]
    others = [line for line in requirements if not line.startswith("pybullet")]
    return "compiled" if resolve(others, system, python) is not None else "more than PyBullet is compiled"


def main() -> None:
    """Print the table."""
    if sys.version_info < (3, 11):
        raise SystemExit("[dev] error: tools/wheels.py needs Python 3.11 or later to read pyproject.toml")
    requirements = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["dependencies"]
    print("| Python |", " | ".join(SYSTEMS), "|")
    print("|---" * (len(SYSTEMS) + 1) + "|")
    for python in PYTHONS:
        print(
            f"| {python} |",
            " | ".join(cell(requirements, system, python) for system in SYSTEMS),
            "|",
            flush=True,
        )


if __name__ == "__main__":
    main()
