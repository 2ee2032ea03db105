"""What `./dev launch` refuses in a launch file before it starts a node."""

import importlib.util
import sys
from types import SimpleNamespace

import pytest

from husky_highlevel_controller.paths import share_folder

TOOLS = share_folder() / "tools"


@pytest.fixture
def launch(monkeypatch):
    """The program, by its path: the folder of launch files has the same name."""
    pytest.importorskip("roslaunch")
    monkeypatch.setattr(sys, "path", [str(TOOLS), *sys.path])
    spec = importlib.util.spec_from_file_location("launch_program", TOOLS / "launch.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)
    return program


@pytest.mark.parametrize("attribute", ["launch-prefix", "args"])
@pytest.mark.parametrize("text", ["xterm -T 'my node -e", '--name "a', "a\\"])
def test_a_quote_without_its_end_is_named_with_the_node(attribute, text, launch):
    node = SimpleNamespace(name="controller", launch_prefix=None, args="")
    setattr(node, attribute.replace("-", "_"), text)
    with pytest.raises(SystemExit) as refusal:
        launch.check_quotes(SimpleNamespace(nodes=[node]))
    assert str(refusal.value).startswith(
        f"[dev] error: node controller: {attribute} = {text!r} has an open quote or "
    )


def test_quotes_that_are_closed_are_taken(launch):
    node = SimpleNamespace(name="a", launch_prefix='bash -c \'sleep 1; "$0" "$@"\'', args='-d "my view.rviz"')
    launch.check_quotes(SimpleNamespace(nodes=[node]))


def test_the_summary_names_the_nodes_and_not_the_hundred_parameters(launch):
    config = SimpleNamespace(
        summary=lambda **_: "SUMMARY\n\nPARAMETERS\n * /speed: 2\n\nNODES\n  /\n    drive\n"
    )
    launch.shorten_summary(config)
    assert config.summary(local=True) == "SUMMARY\n\nNODES\n  /\n    drive\n"


@pytest.mark.parametrize("name", ["parameters", "simulator_parameters"])
def test_an_argument_that_another_file_declares_has_its_own_meaning(name, launch, tmp_path):
    file = tmp_path / "my.launch"
    file.write_text(f'<launch><arg name="{name}"/></launch>')
    assert launch.check_arguments(file, [f"{name}:=fast"]).options == [f"{name}:=fast"]


@pytest.mark.parametrize("of_user", [True, False])
def test_a_parameter_file_of_this_package_must_be_readable(of_user, launch, tmp_path):
    file = own = share_folder() / "launch" / "controller.launch"
    if of_user:
        file = tmp_path / "my.launch"
        file.write_text(f'<launch><include file="{own}"/></launch>')
    with pytest.raises(SystemExit, match="cannot read parameters:=fast"):
        launch.check_arguments(file, ["parameters:=fast"])


def test_an_argument_in_the_brackets_of_a_readme_is_taken(launch):
    file = share_folder() / "launch" / "simulator.launch"
    arguments = launch.check_arguments(file, ["[gui:=false]", "x:=[1,2]", "--screen"])
    assert arguments.options == ["gui:=false", "x:=[1,2]", "--screen"]


def test_a_launch_file_where_the_person_stands_comes_before_this_package_s(launch, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = share_folder() / "launch" / "controller.launch"
    assert launch.find_launch_file(["controller.launch"])[0] == own
    (tmp_path / "controller.launch").write_text("<launch/>")
    assert launch.find_launch_file(["controller.launch"])[0] == tmp_path / "controller.launch"
