"""Dependencies in a package.xml that name no package of this machine, and the names that are probably meant.

In: names of dependencies and of packages. Out: findings, and a sentence for each.
"""

from __future__ import annotations

from typing import Any, Collection, Iterable, List, NamedTuple

from husky_highlevel_controller.spelling import nearest

TAGS = ("depend", "build_depend", "exec_depend", "run_depend", "build_export_depend")
# a known name is suggested for an unknown name if their likeness (0 to 1) is at least this: sensor_msgs for
# sensor_msg, but not tf_conversions for pcl_conversions
MIN_LIKENESS = 0.8


class UnknownDependency(NamedTuple):
    """Dependency that is not a package here."""

    package: str
    dependency: str
    suggestion: str  # name of the installed package that is most similar; empty if no package is similar


def dependencies_of(root: Any) -> List[str]:
    """Return the names of the dependencies of a package.xml, by the root of its ElementTree."""
    names = set()
    for tag in TAGS:
        for node in root.iter(tag):
            names.add(str(node.text or "").strip())
    names.discard("")
    return sorted(names)


def unknown_dependencies(
    package: str, dependencies: Iterable[str], known: Collection[str]
) -> List[UnknownDependency]:
    """Return the dependencies that are not packages, with the package that is probably meant.

    A dependency may also be the name of a library of the system, which no list here has. Such a name has no
    underscore (boost, eigen), or it has a hyphen (python3-numpy). It is returned only if it is similar to the
    name of a package.

    Args:
        package: name of the package that depends.
        dependencies: names in its package.xml.
        known: names of all packages.
    """
    found = []
    for name in dependencies:
        if name in known:
            continue
        suggestion = nearest(name, known, separator="_", least=MIN_LIKENESS) or ""
        # a name with an underscore and without a hyphen cannot be a library, so it is a missing package
        if suggestion or ("_" in name and "-" not in name):
            found.append(UnknownDependency(package, name, suggestion))
    return found


def dependency_sentence(finding: UnknownDependency) -> str:
    """Return a sentence for the user on a dependency that is not a package, with a remedy."""
    remedy = f"did you mean '{finding.suggestion}'?" if finding.suggestion else "correct it, or install it"
    return (
        f"the package.xml of '{finding.package}' depends on '{finding.dependency}', which is not a package "
        f"here: {remedy}"
    )
