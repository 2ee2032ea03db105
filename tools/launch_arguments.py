"""Arguments of a launch file: checked before it runs, and passed on to the files that it includes.

Arguments of this package's simulator can be given to any launch file that starts it. If the file includes
simulator.launch, they are passed on to simulator.launch. If the file uses the stand-ins of compat/, they are
put into the environment, where the stand-ins read them.
"""

from __future__ import annotations

import contextlib
import difflib
import os
import re
import shlex
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Set, Tuple
from xml.etree import ElementTree

import roslaunch.arg_dump
import roslaunch.loader
import yaml
from roslaunch import substitution_args

PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
SIMULATOR = PACKAGE_FOLDER / "launch" / "simulator.launch"
# arguments that simulator.launch declares, because controller.launch passes all on, but does not use
UNUSED_BY_SIMULATOR = {"naive", "parameters"}
VARIABLE = "HUSKY_SIMULATOR_ARGUMENTS"  # name:=value words, as on a command line, for stand-ins of compat/
# variables of the Husky of ROS Melodic, for stand-ins; simulator.launch has the same for robot:=husky_melodic
MELODIC = {"HUSKY_LMS1XX_TOPIC": "scan", "HUSKY_LMS1XX_PREFIX": "base"}


class Arguments(NamedTuple):
    """Checked arguments of a launch file."""

    options: List[str]  # words for roslaunch
    # arguments for the stand-ins of compat/ that start this package's simulator
    for_simulator: Dict[str, str]
    known: Set[str]  # names that the file takes


def declared_arguments(file: Path) -> Optional[Set[str]]:
    """Return the names of the arguments that a launch file takes; None if they are unknown before it runs.

    An include with pass_all_args takes arguments that the file itself does not declare.
    """
    try:
        names = set(roslaunch.arg_dump.get_args([str(file)]))
        if file.name == "simulator.launch" and PACKAGE_FOLDER in file.resolve().parents:
            names -= UNUSED_BY_SIMULATOR
        for included, passes_all in included_files(file):
            inner = declared_arguments(included) if passes_all else set()
            if inner is None:
                return None
            names |= inner
    except Exception:  # roslaunch reports the error, in more detail
        return None
    return names


def included_files(file: Path) -> Iterator[Tuple[Path, bool]]:
    """Return the files that a launch file includes, and whether each gets all its arguments."""
    for include in ElementTree.parse(file).iter("include"):
        context = {"filename": str(file), "arg": {}}
        passes_all = include.get("pass_all_args", "").lower() in ("1", "true")
        try:
            yield Path(substitution_args.resolve_args(include.get("file"), context=context)), passes_all
        except Exception:  # the name of the included file depends on an argument, so it is unknown here
            if passes_all:  # so the arguments that the launch file takes are unknown, too
                raise


def own_arguments(file: Path) -> Set[str]:
    """Return the arguments of the files of this package that a launch file includes.

    A file of this package counts, too, if another package's file includes it.
    """
    names: Set[str] = set()
    with contextlib.suppress(Exception):  # roslaunch reports the error, in more detail
        for included, _ in included_files(file):
            if PACKAGE_FOLDER in included.resolve().parents:
                names |= declared_arguments(included) or set()
            else:
                names |= own_arguments(included)
    return names


def pass_on(values: Dict[str, str]) -> None:
    """Give arguments to the launch files of this package that take them, wherever they are included."""
    process_include_args = roslaunch.loader.process_include_args

    def process(context: Any) -> None:
        """Add the arguments that an included file takes, then process it as roslaunch does."""
        file = Path(context.filename)
        if PACKAGE_FOLDER in file.resolve().parents:
            arguments = context.include_resolve_dict.setdefault("arg", {})
            taken = declared_arguments(file) or set()
            arguments.update({name: value for name, value in values.items() if name in taken})
        process_include_args(context)

    roslaunch.loader.process_include_args = process


def check_arguments(file: Path, given: List[str]) -> Arguments:
    """Check the arguments of a command line; refuse unknown ones, which roslaunch would ignore in silence.

    An argument that the launch file does not take itself is passed on to included files of this package that
    take it. If no file takes it, but the simulator does, the stand-ins of compat/ get it.
    """
    declared, of_included = declared_arguments(file), own_arguments(file)
    # our own launch files start no stand-ins, so these arguments would be lost there
    of_simulator = set() if file.parent == SIMULATOR.parent else declared_arguments(SIMULATOR) or set()
    for_included: Dict[str, str] = {}
    for_simulator: Dict[str, str] = {}
    # people copy arguments from a README that has optional ones in brackets: [verbose:=true]
    given = [re.sub(r"^\[(\w+:=.*)\]$", r"\1", argument) for argument in given]
    for argument in given:
        name, assigned, value = argument.partition(":=")
        if not assigned:  # an option of roslaunch, or a typing error such as name=value
            mistyped = re.fullmatch(r"(\w+)(?:=|:)(.*)", argument)
            if mistyped:
                raise SystemExit(
                    f"[dev] error: {argument!r} is not a valid argument. Write {mistyped[1]}:={mistyped[2]}"
                )
            continue
        # _name:=value is not an argument for roslaunch
        if declared is not None and name not in declared and not name.startswith("_"):
            if name in of_included:
                for_included[name] = value
            elif name in of_simulator:
                for_simulator[name] = value
            else:
                refuse(file, name, declared, declared | of_included | of_simulator)
        # an argument of this name that another package's file declares may mean something else
        is_ours = file.parent == SIMULATOR.parent or name in for_included or name in for_simulator
        if name in ("parameters", "simulator_parameters") and is_ours:
            check_yaml(name, value)
    if for_included:
        pass_on(for_included)
    give_to_stand_ins(for_simulator)
    taken = for_included.keys() | for_simulator.keys()
    options = [argument for argument in given if argument.partition(":=")[0] not in taken]
    return Arguments(options, for_simulator, declared or set())


def give_to_stand_ins(values: Dict[str, str]) -> None:
    """Put arguments of the simulator into the environment, where the stand-ins of compat/ read them."""
    if values:
        words = [f"{name}:={value}" for name, value in values.items()]
        os.environ[VARIABLE] = shlex.join([*shlex.split(os.environ.get(VARIABLE, "")), *words])
    if values.get("robot") == "husky_melodic":
        os.environ.update(MELODIC)


def refuse(file: Path, name: str, takes: Set[str], candidates: Set[str]) -> None:
    """End with a sentence on an argument that a launch file does not take."""
    near = difflib.get_close_matches(name, candidates - {name}, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else "."
    known = ", ".join(sorted(takes)) or "none"
    raise SystemExit(f"[dev] error: {file.name} has no argument '{name}'{hint} It takes: {known}")


def check_yaml(argument: str, path: str) -> None:
    """Refuse a parameter file that cannot be read; roslaunch would end in a traceback."""
    try:
        values = yaml.safe_load(Path(path).read_text())
    except OSError as error:
        raise SystemExit(
            f"[dev] error: cannot read {argument}:={path} in {Path.cwd()}: {error.strerror}. Check the path"
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}" if mark else path
        raise SystemExit(
            f"[dev] error: {where}: not valid YAML: {getattr(error, 'problem', None) or error}"
        ) from None
    if not isinstance(values, dict):
        raise SystemExit(f"[dev] error: {path} must have lines 'parameter: value'")
