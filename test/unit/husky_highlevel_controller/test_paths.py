"""Folders of files that an installed module reads."""

import pytest

from husky_highlevel_controller.datatypes import HuskyError
from husky_highlevel_controller.paths import share_folder


def test_an_installed_module_finds_the_data_beside_its_library_or_reports_the_places_searched(
    monkeypatch, tmp_path
):
    module = tmp_path / "lib/python3/dist-packages/husky_highlevel_controller/paths.py"
    share = tmp_path / "share/husky_highlevel_controller"
    monkeypatch.setattr("husky_highlevel_controller.paths.__file__", str(module))
    with pytest.raises(HuskyError, match=r"no folder urdf/ in .*share/husky_highlevel_controller"):
        share_folder()
    (share / "urdf").mkdir(parents=True)
    assert share_folder() == share.resolve()
