"""Who may import what: the sources are parsed, nothing is run."""

import ast
import io
import re
import tokenize
from functools import lru_cache
from pathlib import Path

import pytest

CORE = "husky_highlevel_controller/"
ROOT = Path(__file__).parents[2]


def short(name):
    """The name of a module with slashes; modules of the core go without their package."""
    return name[len(CORE) :] if name.startswith(CORE) else name


SOURCES = {
    short(path.relative_to(ROOT / "src").with_suffix("").as_posix()): path
    for path in sorted((ROOT / "src").rglob("*.py"))
}
SCRIPTS = sorted((ROOT / "scripts").iterdir())

# room: prefixes of what its modules may import of this package; folders say who belongs to whom
SHARED = sorted(name for name in SOURCES if "/" not in name)
MAY_IMPORT = {
    "simulator": {"simulator"},
    "controller": {"controller"},
    "estimation": {"estimation"},
    "drawing": {"drawing"},
    "husky_evaluation/tasks": {"husky_evaluation/tasks"},
    "husky_evaluation": {"husky_evaluation", "simulator", "controller", "drawing"},
    "husky_grading": {"husky_grading", "husky_evaluation", "drawing"},
    # the stages of marking: each reads the files of the one before, none knows another
    "husky_grading/hand_in": {
        "husky_grading/hand_in",
        "husky_grading/displays",
        "husky_grading/isolation",
        "husky_grading/notes",
        "husky_grading/records",
        "husky_grading/submission",
    },
    "husky_grading/drive": {
        "husky_grading/drive",
        "husky_grading/isolation",
        "husky_grading/notes",
        "husky_grading/recording",
        "husky_grading/records",
        "husky_grading/submission",
    },
    # an exercise says what each stage does for it, so it may use them all; no stage knows an exercise
    "husky_grading/exercises": {
        "husky_grading/exercises",
        "husky_grading/hand_in",
        "husky_grading/drive",
        "husky_grading/rubrics",
        "husky_grading/isolation",
        "husky_grading/displays",
        "husky_grading/notes",
        "husky_grading/recording",
        "husky_grading/records",
        "husky_grading/submission",
    },
    "husky_grading/rubrics": {
        "husky_grading/rubrics",
        "husky_grading/recording",
        "husky_grading/displays",
        "husky_grading/notes",
        "husky_grading/records",
    },
    "husky_grading/reports": {
        "drawing",
        "husky_grading/reports",
        "husky_grading/recording",
        "husky_grading/isolation",
        "husky_grading/records",
    },
    "husky_grading/isolation": {"husky_grading/isolation"},
    "husky_grading/nodes": {"husky_grading", "ros"},
    "ros": {"ros"},
    **{f"ros/{room}": {f"ros/{room}", room} for room in ("simulator", "controller")},
    "ros/estimation": {"ros/estimation", "estimation", "drawing"},  # plot_path draws
    "ros/safety": {"ros/safety", "controller"},
    "husky_web": {"husky_web", "ros", "drawing", "simulator/twist_mux"},
}
ROS = {"rospy", "tf2_ros", "roslib", "roslaunch", "rosgraph", "genpy", "rospkg", "dynamic_reconfigure"}
CLOCKS = {"time", "datetime", "threading", "random"}


@lru_cache(maxsize=None)
def syntax(path):
    return ast.parse(path.read_text(), str(path), feature_version=(3, 8))


@lru_cache(maxsize=None)
def imports(path):
    """Full names of all that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def libraries(name):
    return {imported.split(".")[0] for imported in imports(SOURCES[name])}


def neighbours(name):
    """Modules of ours that a module imports."""
    found = set()
    for imported in imports(SOURCES[name]):
        parts = short(imported.replace(".", "/")).split("/")
        found |= {"/".join(parts[:n]) for n in range(1, len(parts) + 1)} & set(SOURCES)
    return found


def room(name):
    """The longest folder of a module that has a rule of its own; empty for the shared words."""
    folders = name.split("/")[:-1]
    prefixes = ["/".join(folders[:n]) for n in range(len(folders), 0, -1)]
    return next((prefix for prefix in prefixes if prefix in MAY_IMPORT), prefixes[-1] if prefixes else "")


def within(name, folders):
    return any(name == folder or name.startswith(f"{folder}/") for folder in folders)


SHELLS = ("ros", "husky_web", "husky_grading/nodes")  # rooms of ROS nodes
PLAIN = [name for name in SOURCES if not within(name, SHELLS)]


def offenders(rule, names=SOURCES):
    """Modules that a rule is false for; a rule may say with whom, instead of False."""
    return {name: answer for name in names if (answer := rule(name)) is not True}


def test_a_module_imports_only_what_its_room_may():
    def forbidden(name):
        own = room(name)
        assert not own or own in MAY_IMPORT, f"{name}: a folder without a rule; give it one here"
        folders = MAY_IMPORT.get(own, set())
        found = [
            other
            for other in neighbours(name)
            if not other.endswith("__init__")
            and other not in SHARED
            and not within(other, folders)
            and not (own.startswith("ros") and other.startswith("ros/") and other.count("/") == 1)
        ]
        return found or True

    assert not offenders(forbidden)


def test_no_exercise_is_named_outside_of_its_own_file():
    def names(name):
        found = [other for other in neighbours(name) if re.search(r"/exercise_\d+$", other)]
        return found or True

    assert not offenders(names)


def test_libraries_are_loaded_in_their_own_rooms_only():
    def only(where, *names):
        return offenders(lambda name: where(name) or not set(names) & libraries(name))

    assert not only(lambda name: within(name, {"simulator/bullet"}), "pybullet", "pybullet_data")
    assert not only(lambda name: name.split("/")[-1] == "plots", "matplotlib")
    assert not only(
        lambda name: name == "husky_evaluation/tasks/cluster", "dask", "distributed", "cloudpickle"
    )


def test_what_runs_beside_a_submission_imports_nothing_of_this_package():
    # a package of the submission may have the same name
    assert not neighbours("husky_grading/nodes/submission")


def test_only_the_rooms_of_nodes_talk_to_ros():
    def talks(library):
        return library in ROS or library.endswith(("_msgs", "_srvs"))

    assert not offenders(lambda name: not any(map(talks, libraries(name))), PLAIN)


def test_only_grading_tasks_and_ros_keep_time():
    assert not offenders(
        lambda name: (
            within(name, {"husky_grading", "husky_evaluation/tasks"}) or not CLOCKS & libraries(name)
        ),
        PLAIN,
    )


def test_every_module_has_a_docstring_and_loads_on_python_3_8():
    def loads(name):
        module = syntax(SOURCES[name])
        # without it, `X | Y` in a hint is an error
        deferred = len(module.body) == 1 or "__future__.annotations" in imports(SOURCES[name])
        return bool(ast.get_docstring(module)) and deferred

    assert not offenders(loads)


def test_no_type_is_built_by_what_python_3_8_cannot_subscript():
    # in hints __future__ lets it pass; in an alias or a cast it fails on 3.8
    def lines(name):
        module = syntax(SOURCES[name])
        hints = [getattr(node, hint, None) for node in ast.walk(module) for hint in ("annotation", "returns")]
        in_hints = {id(node) for hint in hints if hint is not None for node in ast.walk(hint)}
        found = [
            node.lineno
            for node in ast.walk(module)
            if isinstance(node, ast.Subscript)
            and isinstance(node.value, ast.Name)
            and id(node) not in in_hints
            and node.value.id in {"tuple", "list", "dict", "set", "frozenset", "type"}
        ]
        return found or True

    assert not offenders(lines)


def test_no_two_public_classes_or_functions_have_one_name():
    places = {}
    for name in SOURCES:
        for node in syntax(SOURCES[name]).body:
            if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(name)
    del places["main"]  # each program has one
    assert not {name: modules for name, modules in places.items() if len(modules) > 1}


def test_a_test_file_of_a_package_lies_where_its_module_lies():
    folder = ROOT / "test" / "unit"
    tests = {path.relative_to(folder) for path in folder.rglob("*/test_*.py")}
    modules = {path: short((path.parent / path.stem[5:]).as_posix()) for path in tests}
    assert not {path.as_posix() for path, module in modules.items() if module not in SOURCES}


def test_no_rule_of_marking_searches_a_sentence():
    rooms = {f"husky_grading/{part}" for part in ("exercises", "rubrics", "reports", "judge", "review")}

    def searches(name):
        found = []
        for node in ast.walk(syntax(SOURCES[name])):
            is_method = isinstance(node, ast.Attribute) and node.attr in ("startswith", "endswith")
            is_in = (
                isinstance(node, ast.Compare)
                and isinstance(node.ops[0], (ast.In, ast.NotIn))
                and isinstance(node.left, ast.Constant)
                and isinstance(node.left.value, str)
                and node.left.value != "#"
            )
            if is_method or is_in:
                found.append(node.lineno)
        return found or True

    marking = [name for name in SOURCES if within(name, rooms)]
    assert marking
    assert not offenders(searches, marking)


# first words of a docstring without the noun that a reader would search for
CLAUSE = re.compile(
    r"(What|Who|Whoever|Whom|Whose|That|Those|These|Which|Where|When|Why|How|Of|To|As|It|They|One|Nothing)\b"
)


def docstrings(name):
    """Line and text of each docstring of a module."""
    defined = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = [node for node in ast.walk(syntax(SOURCES[name])) if isinstance(node, defined)]
    return [(getattr(node, "lineno", 1), text) for node in nodes if (text := ast.get_docstring(node))]


def test_no_docstring_begins_with_a_relative_clause():
    def sentences(name):
        found = [text.splitlines()[0] for _, text in docstrings(name)]
        return [text for text in found if CLAUSE.match(text)] or True

    assert not offenders(sentences)


UNIT = r"(?:\([^)]*\),? )?(?:\[[^]]*\][,;:]? )?"
# first words of a comment without its noun; on a line of its own a sentence may begin with "in" or "to"
FRAGMENT = re.compile(UNIT + r"(of|by|whose|who|whoever|whom|what|whatever|which|that|those|the ones?|how)\b")
FRAGMENT_BEHIND_CODE = re.compile(
    UNIT
    + r"(from|to|in|at(?! worst| most| least)|on|for|with|without|when|where|why|since|as|because|so|not|its?"
    r"|they|them|these|before|after|until|unless|if|also|or|and|but|else|both|than|here|there|nothing)\b"
)
UNCLEAR = {
    "a value and a colon instead of 'if'": re.compile(
        r"(?:^|[;,(] ?|\. |\] )(?:none|nan|inf|empty|0|1|true|false): ", re.I
    ),
    "'is no' instead of 'is not a'": re.compile(
        r"(?<!there )\b(?:is|are|was|were) no (?!longer|more\b)", re.I
    ),
    "a participle before its verb": re.compile(r"(?:^|\. )[A-Z][a-z]+ed,? (?:is|are) "),
    "'else' as a conjunction": re.compile(r"[,;] else\b"),
    "a word of dialect": re.compile(r"\b(?:anew|for ever|left away|leave away)\b"),
}
# calls that describe a parameter, and the place of the text among their arguments
DESCRIPTIONS = {"setting": 0, "number": 2, "_number": 1}


def comments(path):
    """Line, text and whether it stands alone, of each comment; lines that follow each other are one."""
    found = []
    for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline):
        if token.type == tokenize.COMMENT:
            line, column = token.start
            alone = not token.line[:column].strip()
            text = token.string.lstrip("#! ")
            if alone and found and found[-1][2:] == (True, line - 1, column):
                first, before, *_ = found.pop()
                found.append((first, f"{before} {text}", True, line, column))
            else:
                found.append((line, text, alone, line, column))
    return [comment[:3] for comment in found]


def test_comments_and_docstrings_are_whole_phrases():
    def unclear(name):
        found = []
        texts = [text.replace("\n", " ") for _, text in docstrings(name)]
        found += [text for text in texts if text.startswith("Whether ")]
        for _, text, alone in comments(SOURCES[name]):
            texts.append(text)
            if FRAGMENT.match(text) or (not alone and FRAGMENT_BEHIND_CODE.match(text)):
                found.append(text)
        found += [f"{law}: {text}" for law, words in UNCLEAR.items() for text in texts if words.search(text)]
        return found or True

    assert not offenders(unclear)


# a sentence of a page, or an error in a docstring, that begins with a pronoun
PRONOUN = re.compile(r"(?:^|[.!?:] )(?:It|They|Its|Their|Those) ")
ERROR_OF_A_PRONOUN = re.compile(r"^ +\w+: (?:it|they|its|their|this|that|these|those)\b")


def test_sentences_of_pages_and_errors_in_docstrings_name_their_subject():
    def unclear(name):
        lines = [line for _, text in docstrings(name) for line in text.splitlines()]
        raised = [line for line in lines if re.match(r" +\w*(?:Error|Exception): ", line)]
        return [line for line in raised if ERROR_OF_A_PRONOUN.match(line)] or True

    assert not offenders(unclear)
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        paragraphs = re.split(r"\n\s*\n|\n(?=\s*(?:-|\d+\.) )|\n(?=\|)", prose)
        texts = [re.sub(r"^\s*(?:-|\d+\.) ", "", " ".join(each.split())) for each in paragraphs]
        found = [text for text in texts if not text.startswith("|") and PRONOUN.search(text)]
        assert not found, page.name


def literal(node):
    """Text of a literal, with {} for each value in an f-string; empty for anything else."""
    if isinstance(node, ast.JoinedStr):
        return "".join(literal(part) or "{}" for part in node.values)
    return str(node.value) if isinstance(node, ast.Constant) else ""


def descriptions(path):
    """Texts for users that describe parameters, and options and programs of argparse."""
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Call):
            place = DESCRIPTIONS.get(getattr(node.func, "attr", getattr(node.func, "id", "")))
            if place is not None and place < len(node.args):
                yield literal(node.args[place])
            yield from (literal(each.value) for each in node.keywords if each.arg in ("help", "description"))
        elif isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values)
            yield from (
                literal(value)
                for key, value in pairs
                if isinstance(key, ast.Constant) and key.value == "help"
            )


def test_descriptions_of_parameters_options_and_arguments_are_whole_phrases():
    programs = (*SOURCES.values(), *(ROOT / "tools").rglob("*.py"))
    texts = {path: list(descriptions(path)) for path in programs}
    for folder in ("launch", "compat", "examples", "test"):
        for path in (ROOT / folder).rglob("*.launch"):
            texts[path] = re.findall(r'\bdoc="([^"]*)"', path.read_text())
    assert sum(map(len, texts.values())) > 300
    begins = (FRAGMENT, FRAGMENT_BEHIND_CODE)
    found = [
        f"{path}: {text}"
        for path, each in texts.items()
        for text in each
        if any(words.match(text) for words in begins) or any(words.search(text) for words in UNCLEAR.values())
    ]
    assert not found


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts_only_call_a_main_and_do_not_shadow_the_package(path):
    # a hand-in does not see our modules
    by_path = path.name in ("other_simulator", "robot_description", "missing_packages")
    assert len(path.read_text().splitlines()) <= (15 if by_path else 12)
    assert path.read_text().startswith("#!/usr/bin/env python3\n")
    assert f"{path.name}/" != CORE or path.is_symlink()  # the node type of the course's sheet
    assert path.suffix == ""
    listed = (ROOT / "CMakeLists.txt").read_text().replace("${PROJECT_NAME}", CORE[:-1])
    assert f"scripts/{path.name}\n" in listed  # or rosrun finds nothing
    check = "husky_highlevel_controller.missing_packages.end_if_missing"
    before = {"signal", "sys", check} if by_path else {"signal", check}  # done before the imports
    (imported,) = imports(path) - before
    module, _, function = imported.rpartition(".")
    assert function == "main"
    assert short(module.replace(".", "/")) in SOURCES
