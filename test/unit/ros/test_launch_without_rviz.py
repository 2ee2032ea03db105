"""`./dev launch` where RViz is not installed."""

import sys
import warnings
from types import SimpleNamespace

import pytest

from husky_highlevel_controller.paths import share_folder

sys.path.insert(0, str(share_folder() / "tools"))
with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # of rosclean, for distutils
    import launch


@pytest.mark.parametrize(
    ("installed", "started"), [(["rviz", "mine"], ["rviz", "mine"]), (["mine"], ["mine"])]
)
def test_its_nodes_are_left_out_in_one_sentence(installed, started, monkeypatch, capsys):
    monkeypatch.setattr(launch.rospkg, "RosPack", lambda: SimpleNamespace(list=lambda: installed))
    config = SimpleNamespace(nodes=[SimpleNamespace(package=name) for name in ("rviz", "mine")])
    launch.drop_missing_rviz(config)
    assert [node.package for node in config.nodes] == started
    assert ("RViz is not installed" in capsys.readouterr().err) == (started == ["mine"])
