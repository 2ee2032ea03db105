"""The legend has a row for everything that is drawn."""

from types import SimpleNamespace
from unittest.mock import Mock

from husky_highlevel_controller.ros.controller.display import COLORS, PATH, STATE
from husky_web.legend import LAYERS, MARKERS, add_layers


def test_each_layer_has_a_box_with_the_dot_of_its_colour_before_it_and_each_marker_a_row():
    gui, changes, boxes = Mock(), [], {}
    gui.add_checkbox.side_effect = lambda title, *_, **__: boxes.setdefault(title, Mock())
    assert add_layers(gui, lambda *change: changes.append(change)) is boxes["depth points"]
    assert list(boxes) == [layer.title for layer in LAYERS]
    htmls = "".join(call.args[0] for call in gui.add_html.call_args_list)
    for layer in LAYERS:
        assert (
            layer.color is None or f"husky-layer-{layer.name}) + * {{ --husky-dot: rgb{layer.color}" in htmls
        )
    (on_update,) = boxes["beams that return"].on_update.call_args.args
    on_update(SimpleNamespace(target=SimpleNamespace(value=False)))
    assert changes == [("rays", False)]
    # the path begins the trail, and the state stands in the panel
    assert {*MARKERS, PATH, STATE} == set(COLORS)
    assert all(f"</i>{title}</div>" in htmls for title in MARKERS.values())
